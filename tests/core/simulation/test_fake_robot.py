"""The fake robot's arithmetic. Needs no ROS."""

from __future__ import annotations

import numpy as np
import pytest

from annik_core.errors import AnnikError, MissingJoint
from annik_core.robots.library import load_robot
from annik_core.simulation.fake_robot import CommandOutsideLimits, FakeRobot, refusal_reason


def test_it_starts_in_the_middle_of_its_working_box() -> None:
    """So that it is somewhere before the first command."""
    robot = load_robot("gantry")
    np.testing.assert_array_equal(FakeRobot(robot).joint_positions, robot.joint_box.centre)


def test_it_goes_where_it_is_told_and_says_where_that_is() -> None:
    """The pose is the direct kinematics of exactly the commanded joint positions."""
    robot = load_robot("gantry")
    fake = FakeRobot(robot)
    command = robot.joint_box.lower + 0.1
    pose = fake.move_to(command)
    np.testing.assert_array_equal(fake.joint_positions, command)
    np.testing.assert_array_equal(pose, robot.forward_kinematics.poses(command[np.newaxis])[0])


@pytest.mark.parametrize("value", [-0.001, 1.6, np.nan, np.inf])
def test_it_stays_where_it_was_when_a_joint_would_leave_its_limits(value: float) -> None:
    """Nothing is clamped."""
    fake = FakeRobot(load_robot("gantry"))
    before = fake.joint_positions
    with pytest.raises(CommandOutsideLimits, match="z_drive_joint"):
        fake.move_to(np.where(np.arange(6) == 2, value, before))
    np.testing.assert_array_equal(fake.joint_positions, before)


def test_refusals_have_short_names() -> None:
    """Known errors by their meaning, all others together."""
    assert refusal_reason(MissingJoint(["a"], ["b"])) == "missing joint"
    assert refusal_reason(CommandOutsideLimits("a would be 9")) == "joint limit"
    assert refusal_reason(AnnikError("anything")) == "other"
