"""Targets as arrays, directly from the bytes that DDS carries (plain CDR, OMG DDSI-RTPS 10.2).

This takes a few microseconds, a message made by the middleware many times as long. Malformed bytes
raise :class:`MalformedMessage` here; the middleware drops them silently.
"""

import struct
from typing import NamedTuple

import numpy as np

from annik_core.errors import ConversionError
from annik_core.pose import FloatArray
from msg_tools.conversions.stamp import join_stamp

#: Encapsulation header: representation identifier (CDR, big or little endian) and options.
_HEADER_SIZE = 4
_BYTE_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}
_POSES = {order: struct.Struct(f"{order}7d") for order in _BYTE_ORDERS.values()}
_POSE_SIZE = 7 * 8
#: Bytes that may pad the last word.
_MOST_PADDING = 3
_LONGEST_FRAME_ID = 1024
#: Length and terminator of an empty text.
_SHORTEST_TEXT = 5


class MalformedMessage(ConversionError):
    """The bytes of a message are not those of its type."""

    def __init__(self, message_type: str, problem: str) -> None:
        self.message_type = message_type
        self.problem = problem
        super().__init__(f"not a {message_type}: {problem}")


class StampedPoses(NamedTuple):
    """Content of a PoseStamped or a PoseArray."""

    nanoseconds: int
    frame_id: str
    poses: FloatArray


def pose_numbers_from_bytes(data: bytes) -> tuple[float, ...]:
    """The seven numbers of a ``geometry_msgs/msg/Pose``, unchecked."""
    order = _byte_order(data, "Pose")
    _check_end(data, _HEADER_SIZE + _POSE_SIZE, "Pose")
    numbers: tuple[float, ...] = _POSES[order].unpack_from(data, _HEADER_SIZE)
    return numbers


def pose_stamped_from_bytes(data: bytes) -> StampedPoses:
    """Content of a ``geometry_msgs/msg/PoseStamped``."""
    order, nanoseconds, frame_id, position = _header(data, "PoseStamped")
    return StampedPoses(nanoseconds, frame_id, _poses(data, order, position, 1, "PoseStamped"))


def pose_array_from_bytes(data: bytes) -> StampedPoses:
    """Content of a ``geometry_msgs/msg/PoseArray``.

    Raises:
        MalformedMessage: if the bytes are not those of a PoseArray.
        InvalidStamp: if the stamp's nanoseconds are a second or more.
    """
    order, nanoseconds, frame_id, position = _header(data, "PoseArray")
    count, position = _count(data, order, position, "PoseArray")
    return StampedPoses(nanoseconds, frame_id, _poses(data, order, position, count, "PoseArray"))


class JointPositions(NamedTuple):
    """Names and positions [rad or m] of a JointState, in its order, unchecked."""

    names: tuple[str, ...]
    positions: tuple[float, ...]


def joint_positions_from_bytes(data: bytes) -> JointPositions:
    """Read the names and positions of a ``sensor_msgs/msg/JointState``."""
    message_type = "JointState"
    order = _byte_order(data, message_type)
    position = _HEADER_SIZE + 8  # the stamp is not read
    _, position = _text(data, order, position, message_type)
    count, position = _count(data, order, position, message_type)
    if count * _SHORTEST_TEXT > len(data) - position:
        raise _too_short(message_type, data)
    names = []
    for _ in range(count):
        name, position = _text(data, order, position, message_type)
        names.append(name)
    begin, end = _doubles(data, order, position, message_type)
    positions = struct.unpack_from(f"{order}{(end - begin) // 8}d", data, begin)
    for _ in ("velocity", "effort"):
        _, end = _doubles(data, order, end, message_type)
    _check_end(data, end, message_type)
    return JointPositions(tuple(names), positions)


def _count(data: bytes, order: str, position: int, message_type: str) -> tuple[int, int]:
    """The length of a sequence at or after ``position``, and where its elements begin."""
    position = _aligned(position, 4)
    if len(data) < position + 4:
        raise _too_short(message_type, data)
    (count,) = struct.unpack_from(f"{order}I", data, position)
    return count, position + 4


def _text(data: bytes, order: str, position: int, message_type: str) -> tuple[str, int]:
    """The text at or after ``position``, and where it ends."""
    length, position = _count(data, order, position, message_type)
    end = position + length
    if length < 1 or len(data) < end or data[end - 1] != 0:
        raise MalformedMessage(message_type, "a text in it has no end")
    try:
        return bytes(data[position : end - 1]).decode(), end
    except UnicodeDecodeError as error:
        raise MalformedMessage(message_type, "a text in it is not UTF-8") from error


def _doubles(data: bytes, order: str, position: int, message_type: str) -> tuple[int, int]:
    """Where the sequence of float64 at or after ``position`` begins and ends."""
    count, position = _count(data, order, position, message_type)
    begin = _aligned(position, 8) if count else position
    end = begin + 8 * count
    if len(data) < end:
        raise _too_short(message_type, data)
    return begin, end


def _byte_order(data: bytes, message_type: str) -> str:
    order = _BYTE_ORDERS.get(bytes(data[:2]))
    if order is None or len(data) < _HEADER_SIZE:
        begin = bytes(data[:_HEADER_SIZE]).hex(" ") or "nothing"
        raise MalformedMessage(message_type, f"it begins with {begin}, which is not CDR")
    return order


def _header(data: bytes, message_type: str) -> tuple[str, int, str, int]:
    """Byte order of the message; stamp [ns], frame and end of its ``std_msgs/msg/Header``."""
    order = _byte_order(data, message_type)
    start = _HEADER_SIZE + 8
    if len(data) < start:
        raise _too_short(message_type, data)
    seconds, nanosec = struct.unpack_from(f"{order}iI", data, _HEADER_SIZE)
    frame_id, end = _text(data, order, start, message_type)
    if end - start > 4 + _LONGEST_FRAME_ID:
        raise MalformedMessage(message_type, f"its frame_id has {end - start - 4} bytes")
    return order, join_stamp(seconds, nanosec), frame_id, end


def _poses(data: bytes, order: str, position: int, count: int, message_type: str) -> FloatArray:
    position = _aligned(position, 8) if count else position
    _check_end(data, position + count * _POSE_SIZE, message_type)
    numbers = np.frombuffer(data, f"{order}f8", count * 7, position)
    return numbers.reshape(count, 7).astype(np.float64)


def _aligned(position: int, size: int) -> int:
    """The next position aligned to ``size`` bytes, counted from the end of the header."""
    return _HEADER_SIZE + -(-(position - _HEADER_SIZE) // size) * size


def _check_end(data: bytes, end: int, message_type: str) -> None:
    if len(data) < end:
        raise _too_short(message_type, data)
    if len(data) > end + _MOST_PADDING:
        raise MalformedMessage(message_type, f"it has {len(data)} bytes, not {end}")


def _too_short(message_type: str, data: bytes) -> MalformedMessage:
    return MalformedMessage(message_type, f"it ends after {len(data)} bytes")
