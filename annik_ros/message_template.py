"""Messages that are serialized once and then only filled in, number by number.

The middleware takes bytes as they are; to let it convert a message anew each time takes several
times as long.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message

from annik_core.pose import FloatArray
from msg_tools.stamp import split_stamp, stamp_to_message

#: A stamp that no clock shows [ns].
_STAMP = -2_000_000_011_987_654_321


class MessageTemplate:
    """The bytes of a message with a header stamp and an array of numbers, both to be replaced.

    Args:
        make_message: makes the message of a stamp and of numbers.
        size: how many numbers there are.
    """

    def __init__(self, make_message: Callable[[Time, list[float]], Any], size: int) -> None:
        # Found by looking for them, so that no layout need be known here.
        numbers = [-7.25e300 - 1e290 * index for index in range(size)]
        self._data = bytearray(_serialized(make_message(stamp_to_message(_STAMP), numbers)))
        self._stamp = struct.Struct("=iI")
        self._numbers = struct.Struct(f"={size}d")
        self._stamp_position = self._data.index(self._stamp.pack(*split_stamp(_STAMP)))
        self._numbers_position = self._data.index(self._numbers.pack(*numbers))

    def filled(self, stamp: int, numbers: FloatArray) -> bytes:
        """The message with this stamp [ns] and these numbers ``(size,)``.

        Raises:
            StampOutOfRange: if the stamp does not fit into a message.
        """
        self._stamp.pack_into(self._data, self._stamp_position, *split_stamp(stamp))
        self._numbers.pack_into(self._data, self._numbers_position, *numbers.tolist())
        return bytes(self._data)


def _serialized(message: Any) -> bytes:
    """The bytes of a message, and none behind them.

    Behind an empty array the middleware leaves room for the alignment of what is not there: some
    bytes of whatever its memory holds. Readers that are exact refuse a message with such an end.
    """
    data: bytes = serialize_message(message)
    while _reads_as(data[:-1], message):
        data = data[:-1]
    return data


def _reads_as(data: bytes, message: Any) -> bool:
    try:
        return bool(deserialize_message(data, type(message)) == message)
    except RuntimeError:
        return False
