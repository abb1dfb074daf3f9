"""The fake robot's arithmetic. Needs no ROS."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from support.continuous_arm import CONTINUOUS_URDF, OPTIONS

from annik_core.errors import AnnikError, MissingJoint
from annik_core.reachable_paths import start_positions
from annik_core.robots.library import load_robot
from annik_core.simulation.fake_robot import CommandOutsideLimits, FakeRobot, refusal_reason
from annik_core.simulation.imperfections import Imperfections


@pytest.mark.parametrize("name", ["gantry", "ur5e"])
def test_it_starts_where_paths_start(name: str) -> None:
    """So that it is somewhere before the first command, and near the first target."""
    robot = load_robot(name)
    np.testing.assert_array_equal(FakeRobot(robot).joint_positions, start_positions(robot))


def test_it_goes_where_it_is_told_and_says_where_that_is() -> None:
    """The pose is the direct kinematics of exactly the commanded joint positions."""
    robot = load_robot("gantry")
    fake = FakeRobot(robot)
    command = robot.joint_box.lower + 0.1
    pose = fake.move_to(command)
    np.testing.assert_array_equal(fake.joint_positions, command)
    np.testing.assert_array_equal(pose, robot.forward_kinematics.poses(command[np.newaxis])[0])


def test_a_continuous_joint_may_be_commanded_in_any_turn() -> None:
    """Its backlash is where it was after a full turn."""
    robot = load_robot(CONTINUOUS_URDF, **OPTIONS)
    imperfections = dataclasses.replace(Imperfections.none(6), backlash=np.full(6, 0.02))
    fake = FakeRobot(robot, imperfections)
    command = robot.joint_box.centre
    command[0] = 3.13
    fake.move_to(command)
    # Backwards by less than the backlash: the arm stays, whatever turn the command counts.
    command[0] -= 0.01
    there = fake.move_to(command)
    for turns in (-1, 5, 1000):
        command = command.copy()
        command[0] = 3.12 + 2 * np.pi * turns
        np.testing.assert_allclose(fake.move_to(command), there, atol=1e-9)
        np.testing.assert_array_equal(fake.joint_positions, command)


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
