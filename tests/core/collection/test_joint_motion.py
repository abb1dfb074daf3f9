"""Motions are straight, at limited speed, and end where they should. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from annik_core.collection.motion import JointMotion

WAYPOINTS = st.integers(1, 4).flatmap(
    lambda n: arrays(np.float64, (n, 3), elements=st.floats(-3, 3, width=32))
)
LIMITS = st.floats(0.1, 5.0)


@given(WAYPOINTS, LIMITS, LIMITS)
def test_no_joint_exceeds_the_limits_or_leaves_the_box_of_the_waypoints(
    waypoints, velocity, acceleration
) -> None:
    motion = JointMotion(waypoints, velocity, acceleration)
    times, step = np.linspace(0.0, motion.duration, 501, retstep=True)
    positions = np.array([motion.joint_positions_at(time) for time in times])
    assert (positions >= waypoints.min(axis=0)).all()
    assert (positions <= waypoints.max(axis=0)).all()
    if motion.duration > 0:
        velocities = np.diff(positions, axis=0) / step
        assert np.abs(velocities).max() <= velocity * (1 + 1e-6) + 1e-9
        changes = np.abs(np.diff(velocities, axis=0)) / step
        assert changes.max() <= acceleration * (1 + 1e-4) + 1e-6 / step


@given(WAYPOINTS, LIMITS)
@example(np.array([[1.0, 0.0, 0.0], [4.5e-36, 0.0, 0.0], [0.0, 0.0, 0.0]]), 1.0)
def test_it_begins_and_ends_at_its_waypoints_exactly(waypoints, velocity) -> None:
    motion = JointMotion(waypoints, velocity, 1.0)
    assert (motion.joint_positions_at(motion.duration) == waypoints[-1]).all()
    assert (motion.joint_positions_at(motion.duration + 9.0) == waypoints[-1]).all()
    if motion.duration > 0:
        assert motion.joint_positions_at(-1.0) == pytest.approx(motion.joint_positions_at(0.0))


def test_the_joints_move_in_proportion() -> None:
    motion = JointMotion(np.array([[0.0, 1.0], [2.0, 0.0]]), 0.5, 1.0)
    for time in np.linspace(0.0, motion.duration, 20):
        first, second = motion.joint_positions_at(time)
        assert first / 2.0 == pytest.approx(1.0 - second)


def test_a_long_way_takes_as_long_as_at_full_speed_and_one_ramp() -> None:
    assert JointMotion(np.array([[0.0], [3.0]]), 0.5, 1.0).duration == pytest.approx(6.5)


def test_a_short_way_is_over_before_full_speed() -> None:
    assert JointMotion(np.array([[0.0], [0.01]]), 0.5, 1.0).duration == pytest.approx(0.2)


def test_it_stops_at_the_waypoint_between() -> None:
    motion = JointMotion(np.array([[0.0], [1.0], [0.0]]), 0.5, 1.0)
    middle = 0.5 * motion.duration
    assert motion.joint_positions_at(middle) == pytest.approx([1.0])
    assert motion.joint_positions_at(middle - 1e-3) == pytest.approx([1.0], abs=1e-6)
