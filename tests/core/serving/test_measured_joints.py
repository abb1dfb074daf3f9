"""The newest position of every joint, from messages of many publishers. ROS-free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.serving.measured_joints import JointStateFault, MeasuredJoints

NAMES = ("shoulder", "elbow", "wrist")


@pytest.fixture
def measured() -> MeasuredJoints:
    return MeasuredJoints(NAMES, timeout=0.5)


def positions(measured: MeasuredJoints, now: float) -> list[float] | None:
    newest = measured.newest(now)
    return None if newest is None else newest.joint_positions.tolist()


def test_nothing_is_known_before_the_first_message(measured: MeasuredJoints) -> None:
    assert measured.newest(0.0) is None
    assert measured.missing(0.0) is None


def test_positions_are_matched_by_name(measured: MeasuredJoints) -> None:
    measured.update(0.0, ["wrist", "finger", "shoulder", "elbow"], [3.0, 9.0, 1.0, 2.0])
    assert positions(measured, 0.1) == [1.0, 2.0, 3.0]
    assert measured.missing(0.1) is None


def test_what_was_found_does_not_change_with_later_messages(measured: MeasuredJoints) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    found = measured.newest(0.0)
    measured.update(0.1, NAMES, [4.0, 5.0, 6.0])
    assert found is not None
    assert found.joint_positions.tolist() == [1.0, 2.0, 3.0]


def test_every_message_is_counted(measured: MeasuredJoints) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    measured.update(0.0, ["finger"], [1.0])
    measured.update(0.0, NAMES, [])
    measured.update(0.0, NAMES, [1.0])
    measured.malformed(0.0, "it ends after 3 bytes")
    assert (measured.received, measured.foreign) == (5, 1)
    assert sum(measured.faults.values()) == 2


@pytest.mark.parametrize("others", [0, 1, 25, 10_000])
def test_messages_of_a_gripper_push_nothing_out(measured: MeasuredJoints, others: int) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    for _ in range(others):
        measured.update(0.1, ["finger"], [0.02])
    assert positions(measured, 0.4) == [1.0, 2.0, 3.0]
    assert measured.foreign == others


def test_joints_in_several_messages_are_merged(measured: MeasuredJoints) -> None:
    measured.update(0.0, NAMES[:1], [1.0])
    assert measured.newest(0.0) is None
    measured.update(0.2, NAMES[1:], [2.0, 3.0])
    newest = measured.newest(0.3)
    assert newest is not None
    assert newest.joint_positions.tolist() == [1.0, 2.0, 3.0]
    assert newest.arrival == 0.0


def test_one_joint_that_is_too_old_is_enough(measured: MeasuredJoints) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    measured.update(0.4, NAMES[:2], [1.0, 2.0])
    assert positions(measured, 0.5) is not None
    assert positions(measured, 0.51) is None
    assert "wrist" in str(measured.missing(0.51))


def test_silence_of_all_is_no_fault_but_a_silent_arm_beside_a_gripper_is(
    measured: MeasuredJoints,
) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    assert measured.newest(1.0) is None
    assert measured.missing(1.0) is None
    measured.update(1.0, ["finger"], [0.1])
    assert "shoulder" in str(measured.missing(1.0))


@pytest.mark.parametrize("time", [math.nan, math.inf])
def test_a_time_that_is_none_finds_nothing(measured: MeasuredJoints, time: float) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    assert measured.newest(time) is None


@pytest.mark.parametrize(
    ("names", "values", "fault"),
    [
        (NAMES, [1.0, 2.0], JointStateFault.LENGTHS),
        ((*NAMES, "finger"), [1.0, 2.0, 3.0], JointStateFault.LENGTHS),
        ((*NAMES, "elbow"), [1.0, 2.0, 3.0, 4.0], JointStateFault.REPEATED),
        (NAMES, [1.0, math.nan, 3.0], JointStateFault.NOT_FINITE),
        (NAMES, [1.0, math.inf, 3.0], JointStateFault.NOT_FINITE),
    ],
)
def test_what_can_not_be_used_is_counted_and_leaves_no_position(
    measured: MeasuredJoints, names: tuple[str, ...], values: list[float], fault: JointStateFault
) -> None:
    assert measured.update(0.0, names, values) is fault
    assert measured.faults[fault] == 1
    assert measured.newest(0.0) is None
    assert measured.missing(0.0) is not None


def test_an_older_usable_position_outlives_an_unusable_one(measured: MeasuredJoints) -> None:
    measured.update(0.0, NAMES, [1.0, 2.0, 3.0])
    measured.update(0.1, NAMES, [math.nan] * 3)
    measured.update(0.1, (*NAMES, "wrist"), [9.0] * 4)
    assert positions(measured, 0.2) == [1.0, 2.0, 3.0]


def test_a_message_without_positions_is_no_fault(measured: MeasuredJoints) -> None:
    assert measured.update(0.0, NAMES, []) is None
    assert not any(measured.faults.values())


def test_a_repeated_joint_of_another_device_is_no_fault(measured: MeasuredJoints) -> None:
    names = (*NAMES, "finger", "finger")
    assert measured.update(0.0, names, [1.0, 2.0, 3.0, 0.1, math.nan]) is None
    assert positions(measured, 0.0) == [1.0, 2.0, 3.0]


class TestStaysUnknown:
    """Messages of use come for longer than the timeout, and a joint is not among them."""

    def told(self, measured: MeasuredJoints, *messages: tuple[float, list[str]]) -> list[float]:
        """When it holds, of messages at these times with these joints."""
        times = []
        for time, names in messages:
            measured.update(time, names, [0.1] * len(names))
            if measured.stays_unknown(time):
                times.append(time)
        return times

    def test_of_other_names_after_the_timeout(self, measured: MeasuredJoints) -> None:
        others = [(0.2 * count, ["left_elbow"]) for count in range(6)]
        assert self.told(measured, *others) == pytest.approx([0.6, 0.8, 1.0])

    def test_not_of_joints_that_come_in_parts(self, measured: MeasuredJoints) -> None:
        parts = [(0.1 * count, [NAMES[count % 3]]) for count in range(20)]
        assert self.told(measured, *parts) == []

    def test_not_of_an_arm_that_is_slower_than_the_timeout(self, measured: MeasuredJoints) -> None:
        """Unless others come between for so long."""
        arm = [(float(count), list(NAMES)) for count in range(5)]
        assert self.told(measured, *arm) == []
        gripper = [(5.0 + 0.1 * count, ["finger"]) for count in range(12)]
        assert self.told(measured, *gripper) == pytest.approx([5.6, 5.7, 5.8, 5.9, 6.0, 6.1])
        assert self.told(measured, (6.2, list(NAMES)), (6.3, ["finger"])) == []

    def test_not_while_a_fault_explains_it(self, measured: MeasuredJoints) -> None:
        for step in range(20):
            measured.update(0.1 * step, NAMES, [1.0])
            assert not measured.stays_unknown(0.1 * step)
        assert self.told(measured, (2.3, ["finger"]), (2.5, ["finger"])) == [2.5]


def test_a_prefix_is_named(measured: MeasuredJoints) -> None:
    measured.update(0.0, [f"left_{name}" for name in NAMES], [1.0, 2.0, 3.0])
    reason = str(measured.missing(0.0))
    assert "'left_'" in reason
    assert "shoulder" in reason


@given(
    st.lists(
        st.tuples(
            st.floats(0.0, 1.0),
            st.lists(st.sampled_from((*NAMES, "finger")), max_size=5),
            st.lists(st.floats(-4.0, 4.0), max_size=5),
        ),
        max_size=30,
    )
)
def test_it_is_the_newest_usable_position_of_each_joint(
    messages: list[tuple[float, list[str], list[float]]],
) -> None:
    measured = MeasuredJoints(NAMES, timeout=0.5)
    known: dict[str, tuple[float, float]] = {}
    now = 0.0
    for step, names, values in messages:
        now += step
        measured.update(now, names, values)
        own = [name for name in names if name in NAMES]
        if len(names) == len(values) and len(set(own)) == len(own):
            known |= {name: (now, value) for name, value in zip(names, values, strict=True)}
    fresh = all(name in known and now - known[name][0] <= 0.5 for name in NAMES)
    newest = measured.newest(now)
    assert (newest is not None) == fresh
    if newest is not None:
        np.testing.assert_array_equal(newest.joint_positions, [known[name][1] for name in NAMES])
