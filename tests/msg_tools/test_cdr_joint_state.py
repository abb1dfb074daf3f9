"""Joint states from raw bytes, compared with rosbags as another reader of CDR."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from msg_tools.conversions.cdr import MalformedMessage, joint_positions_from_bytes

JAZZY = get_typestore(Stores.ROS2_JAZZY)
TYPE = "sensor_msgs/msg/JointState"
texts = st.text(
    st.characters(blacklist_categories=("Cs",), blacklist_characters="\x00"), max_size=12
)
numbers = st.lists(st.floats(width=64), max_size=8)


def joint_state(
    names: list[str],
    positions: list[float],
    velocities: list[float],
    frame_id: str = "",
    *,
    little_endian: bool = True,
) -> bytes:
    types = JAZZY.types
    stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    message = types[TYPE](
        header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id),
        name=names,
        position=np.array(positions, dtype=np.float64),
        velocity=np.array(velocities, dtype=np.float64),
        effort=np.array([], dtype=np.float64),
    )
    return bytes(JAZZY.serialize_cdr(message, TYPE, little_endian=little_endian))


@given(st.lists(texts, max_size=8), numbers, numbers, texts, st.booleans())
def test_it_reads_what_rosbags_wrote(
    names: list[str],
    positions: list[float],
    velocities: list[float],
    frame_id: str,
    little_endian: bool,
) -> None:
    data = joint_state(names, positions, velocities, frame_id, little_endian=little_endian)
    read = joint_positions_from_bytes(data)
    assert list(read.names) == names
    np.testing.assert_array_equal(read.positions, positions)


GOOD = joint_state(["a", "bc"], [1.0, 2.0], [3.0, 4.0], "base")


@pytest.mark.parametrize("size", range(len(GOOD)))
def test_a_truncated_message_is_refused(size: int) -> None:
    with pytest.raises(MalformedMessage):
        joint_positions_from_bytes(GOOD[:size])


def test_random_bytes_are_read_or_refused() -> None:
    rng = random.Random(7)
    for _ in range(10_000):
        data = bytearray(GOOD)
        for _ in range(rng.randint(1, 6)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        try:
            joint_positions_from_bytes(bytes(data))
        except MalformedMessage as error:
            assert error.message_type == "JointState"


def test_a_huge_count_is_refused_at_once() -> None:
    data = bytearray(joint_state(["a"], [1.0], []))
    data[20:24] = (0xFFFFFFFF).to_bytes(4, "little")
    with pytest.raises(MalformedMessage):
        joint_positions_from_bytes(bytes(data))
