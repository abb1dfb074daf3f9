"""Targets as arrays, straight from the bytes that DDS carries (plain CDR, OMG DDSI-RTPS 10.2).

To read a pose from its bytes takes a few microseconds; to let the middleware make a message first,
and read that, takes many times as long. And what is no message at all is seen, named and counted
here, where the middleware would drop it.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from annik_core.errors import ConversionError
from annik_core.pose import FloatArray
from msg_tools.conversions.stamp import NANOSECONDS_PER_SECOND, MalformedStamp

#: Encapsulation header: representation identifier (CDR, big or little endian) and options.
_HEADER_SIZE = 4
_BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
_POSES = {order: struct.Struct(f"{order}7d") for order in _BYTE_ORDERS.values()}
_POSE_SIZE = 7 * 8
#: The last bytes may fill up a word.
_MOST_PADDING = 3
_LONGEST_FRAME_ID = 1024


class MalformedMessage(ConversionError):
    """The bytes of a message are not those of its type."""

    def __init__(self, message_type: str, problem: str) -> None:
        self.message_type = message_type
        self.problem = problem
        super().__init__(f"not a {message_type}: {problem}")


class StampedPoses(NamedTuple):
    """What a PoseStamped or a PoseArray says.

    Attributes:
        nanoseconds: the stamp, since the epoch of the clock that made it [ns].
        frame_id: as it stands in the message.
        poses: ``(n, 7)`` unchecked; a PoseStamped has one.
    """

    nanoseconds: int
    frame_id: str
    poses: FloatArray


def pose_from_bytes(data: bytes) -> FloatArray:
    """The seven numbers ``(7,)`` of a ``geometry_msgs/msg/Pose`` as they are.

    Raises:
        MalformedMessage: if the bytes are not those of a Pose.
    """
    return np.array(pose_numbers_from_bytes(data))


def pose_numbers_from_bytes(data: bytes) -> tuple[float, ...]:
    """:func:`pose_from_bytes` as a tuple, for who makes an array of it anyway.

    Raises:
        MalformedMessage: if the bytes are not those of a Pose.
    """
    order = _byte_order(data, "Pose")
    _check_end(data, _HEADER_SIZE + _POSE_SIZE, "Pose")
    numbers: tuple[float, ...] = _POSES[order].unpack_from(data, _HEADER_SIZE)
    return numbers


def pose_stamped_from_bytes(data: bytes) -> StampedPoses:
    """What a ``geometry_msgs/msg/PoseStamped`` says; its pose is unchecked.

    Raises:
        MalformedMessage: if the bytes are not those of a PoseStamped.
        MalformedStamp: if the stamp's nanoseconds are a second or more.
    """
    order, nanoseconds, frame_id, position = _header(data, "PoseStamped")
    return StampedPoses(nanoseconds, frame_id, _poses(data, order, position, 1, "PoseStamped"))


def pose_array_from_bytes(data: bytes) -> StampedPoses:
    """What a ``geometry_msgs/msg/PoseArray`` says; its poses are unchecked.

    Raises:
        MalformedMessage: if the bytes are not those of a PoseArray.
        MalformedStamp: if the stamp's nanoseconds are a second or more.
    """
    order, nanoseconds, frame_id, position = _header(data, "PoseArray")
    position = _aligned(position, 4)
    if len(data) < position + 4:
        raise _too_short("PoseArray", data)
    (count,) = struct.unpack_from(f"{order}I", data, position)
    if count == 0:
        _check_end(data, position + 4, "PoseArray")
        return StampedPoses(nanoseconds, frame_id, np.empty((0, 7)))
    poses = _poses(data, order, position + 4, count, "PoseArray")
    return StampedPoses(nanoseconds, frame_id, poses)


def _byte_order(data: bytes, message_type: str) -> str:
    order = _BYTE_ORDERS.get(bytes(data[:2]))
    if order is None or len(data) < _HEADER_SIZE:
        begin = bytes(data[:_HEADER_SIZE]).hex(" ") or "nothing"
        raise MalformedMessage(message_type, f"it begins with {begin}, which is no CDR")
    return order


def _header(data: bytes, message_type: str) -> tuple[str, int, str, int]:
    """The byte order; stamp [ns], frame and end of the ``std_msgs/msg/Header`` that follows."""
    order = _byte_order(data, message_type)
    start = _HEADER_SIZE + 12
    if len(data) < start:
        raise _too_short(message_type, data)
    seconds, nanosec, length = struct.unpack_from(f"{order}iII", data, _HEADER_SIZE)
    if not 1 <= length <= _LONGEST_FRAME_ID:
        raise MalformedMessage(message_type, f"its frame_id has {length} bytes")
    end = start + length
    text = bytes(data[start:end])
    if len(data) < end or text[-1] != 0:
        raise MalformedMessage(message_type, "its frame_id has no end")
    if nanosec >= NANOSECONDS_PER_SECOND:
        raise MalformedStamp(nanosec)
    try:
        frame_id = text[:-1].decode()
    except UnicodeDecodeError as error:
        raise MalformedMessage(message_type, "its frame_id is no UTF-8 text") from error
    return order, seconds * NANOSECONDS_PER_SECOND + nanosec, frame_id, end


def _poses(data: bytes, order: str, position: int, count: int, message_type: str) -> FloatArray:
    position = _aligned(position, 8)
    _check_end(data, position + count * _POSE_SIZE, message_type)
    numbers = np.frombuffer(data, f"{order}f8", count * 7, position)
    return numbers.reshape(count, 7).astype(np.float64)


def _aligned(position: int, size: int) -> int:
    """The next position at a multiple of ``size``, counted from behind the header."""
    return _HEADER_SIZE + -(-(position - _HEADER_SIZE) // size) * size


def _check_end(data: bytes, end: int, message_type: str) -> None:
    if len(data) < end:
        raise _too_short(message_type, data)
    if len(data) > end + _MOST_PADDING:
        raise MalformedMessage(message_type, f"it has {len(data)} bytes, not {end}")


def _too_short(message_type: str, data: bytes) -> MalformedMessage:
    return MalformedMessage(message_type, f"it ends after {len(data)} bytes")
