"""Targets from raw bytes, held against two other readers of CDR: the middleware and rosbags."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from annik_core.errors import ConversionError
from annik_core.pose import FloatArray
from msg_tools.conversions.cdr import (
    pose_array_from_bytes,
    pose_numbers_from_bytes,
    pose_stamped_from_bytes,
)

JAZZY = get_typestore(Stores.ROS2_JAZZY)
READERS: dict[str, Callable[[bytes], Any]] = {
    "Pose": lambda data: np.array(pose_numbers_from_bytes(data)),
    "PoseStamped": pose_stamped_from_bytes,
    "PoseArray": pose_array_from_bytes,
}
FUZZED = 10_000

numbers = st.floats(width=64)
poses = st.lists(st.tuples(*[numbers] * 7), min_size=1, max_size=4)
# A NUL ends a text for some readers and not for others; ours keeps it, and no frame has it.
frames = st.text(
    st.characters(blacklist_categories=("Cs",), blacklist_characters="\x00"), max_size=20
)
stamps = st.tuples(st.integers(-(2**31), 2**31 - 1), st.integers(0, 10**9 - 1))


def _make(message_type: str, **fields: Any) -> Any:
    return JAZZY.types[message_type](**fields)


def _pose(values: tuple[float, ...]) -> Any:
    x, y, z, i, j, k, w = values
    return _make(
        "geometry_msgs/msg/Pose",
        position=_make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=_make("geometry_msgs/msg/Quaternion", x=i, y=j, z=k, w=w),
    )


def _bytes_of(
    kind: str,
    values: list[tuple[float, ...]],
    frame_id: str,
    stamp: tuple[int, int],
    little_endian: bool,
) -> bytes:
    """A message as rosbags writes it."""
    header = _make(
        "std_msgs/msg/Header",
        stamp=_make("builtin_interfaces/msg/Time", sec=stamp[0], nanosec=stamp[1]),
        frame_id=frame_id,
    )
    message_type = f"geometry_msgs/msg/{kind}"
    if kind == "Pose":
        message = _pose(values[0])
    elif kind == "PoseStamped":
        message = _make(message_type, header=header, pose=_pose(values[0]))
    else:
        message = _make(message_type, header=header, poses=[_pose(value) for value in values])
    return bytes(JAZZY.serialize_cdr(message, message_type, little_endian=little_endian))


def _numbers_of(result: Any) -> FloatArray:
    return result.reshape(1, 7) if isinstance(result, np.ndarray) else result.poses


@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=300)
@given(values=poses, frame_id=frames, stamp=stamps, little_endian=st.booleans())
def test_what_rosbags_writes_is_read_to_the_last_bit(
    kind: str,
    values: list[tuple[float, ...]],
    frame_id: str,
    stamp: tuple[int, int],
    little_endian: bool,
) -> None:
    data = _bytes_of(kind, values, frame_id, stamp, little_endian)
    result = READERS[kind](data)
    expected = np.array(values if kind == "PoseArray" else values[:1])
    np.testing.assert_array_equal(_numbers_of(result), expected)
    if kind != "Pose":
        assert result.frame_id == frame_id
        assert result.nanoseconds == stamp[0] * 10**9 + stamp[1]


@pytest.mark.parametrize("kind", READERS)
def test_every_truncation_and_every_longer_message_is_refused(kind: str) -> None:
    """But for the three bytes that may fill up a word."""
    for frame_id in ("", "base_link"):
        data = _bytes_of(kind, [(1.0,) * 7] * 2, frame_id, (1, 2), True)
        for size in range(len(data)):
            with pytest.raises(ConversionError):
                READERS[kind](data[:size])
        for extra in (4, 5, 8, 56, 10_000):
            with pytest.raises(ConversionError):
                READERS[kind](data + bytes(extra))
        for extra in range(4):
            READERS[kind](data + bytes(extra))


@pytest.mark.parametrize("kind", READERS)
@settings(max_examples=500)
@given(data=st.binary(max_size=400))
def test_random_bytes_are_read_or_refused(kind: str, data: bytes) -> None:
    """Nothing else: no other exception, and no memory for what a length only claims."""
    for begin in (b"", b"\x00\x01\x00\x00", b"\x00\x00\x00\x00"):
        try:
            result = READERS[kind](begin + data)
        except ConversionError:
            continue
        assert _numbers_of(result).shape[1:] == (7,)


@pytest.mark.parametrize("kind", READERS)
def test_a_length_that_lies_is_refused_at_once(kind: str) -> None:
    data = bytearray(_bytes_of(kind, [(1.0,) * 7], "base", (1, 2), True))
    for position in range(4, len(data) - 3, 4):
        for length in (2**31 - 1, 2**31, 2**32 - 1):
            changed = data.copy()
            struct.pack_into("<I", changed, position, length)
            try:
                poses_read = _numbers_of(READERS[kind](bytes(changed)))
            except ConversionError:
                continue
            assert len(poses_read) == 1


def test_a_path_of_no_poses_is_one() -> None:
    data = _bytes_of("PoseArray", [], "base", (1, 2), True)
    assert pose_array_from_bytes(data).poses.shape == (0, 7)


@pytest.mark.ros
@pytest.mark.parametrize("kind", READERS)
def test_what_is_read_is_what_the_middleware_reads(kind: str) -> None:
    """10,000 messages with changed bytes: no other numbers, and nothing that it would not take."""
    pytest.importorskip("rclpy")
    from geometry_msgs import msg
    from rclpy.serialization import deserialize_message

    message_type = getattr(msg, kind)
    random = np.random.default_rng(5)
    sound = [
        _bytes_of(kind, [(0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0)] * count, frame, (1, 2), little)
        for count in (1, 3)
        for frame in ("", "base_link")
        for little in (True, False)
    ]
    read = 0
    for _ in range(FUZZED):
        data = bytearray(sound[int(random.integers(len(sound)))])
        for _ in range(int(random.integers(1, 4))):
            data[int(random.integers(len(data)))] = int(random.integers(256))
        try:
            result = READERS[kind](bytes(data))
        except ConversionError:
            continue
        read += 1
        message = deserialize_message(bytes(data), message_type)
        expected = message.poses if kind == "PoseArray" else [getattr(message, "pose", message)]
        np.testing.assert_array_equal(_numbers_of(result), [_seven(pose) for pose in expected])
        if kind != "Pose":
            assert result.frame_id.split("\x00")[0] == message.header.frame_id
            stamp = message.header.stamp
            assert result.nanoseconds == stamp.sec * 10**9 + stamp.nanosec
    assert read > FUZZED / 10


def _seven(pose: Any) -> list[float]:
    position, turn = pose.position, pose.orientation
    return [position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w]
