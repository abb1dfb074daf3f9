"""The packaged models are of the packaged robots, and do what docs/arms.md says. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest

from annik_core.installation import packaged_models
from annik_core.model.artifact import load_model
from annik_core.pose import pose_distance
from annik_core.robots.library import load_robot, packaged_robots
from annik_core.solver.ik_solver import IkSolver

ARMS = [name for name in packaged_robots() if load_robot(name).kind == "arm"]


def test_every_packaged_robot_has_a_model() -> None:
    assert packaged_models() == packaged_robots()


@pytest.mark.parametrize("name", packaged_robots())
def test_a_packaged_model_is_of_the_packaged_robot(name: str) -> None:
    """A change of a robot's definition asks for ``./run bench arms``."""
    load_model(name, expected_robot=load_robot(name))


@pytest.mark.parametrize("name", ARMS)
def test_at_least_995_of_1000_targets_of_the_joint_box_are_solved(name: str) -> None:
    """Within a micrometre and a micro-radian, inside the box, in at most ten iterations."""
    solver = IkSolver.from_file(name)
    robot = solver.robot
    rng = np.random.default_rng(995)
    inside = rng.uniform(robot.joint_box.lower, robot.joint_box.upper, (1000, robot.dof))
    targets = robot.forward_kinematics.poses(inside)
    solved = 0
    for target, result in zip(targets, solver.solve_batch(targets), strict=True):
        if result.joint_positions is None:
            continue
        assert robot.joint_box.contains(result.joint_positions)
        assert result.newton_steps <= 10
        achieved = robot.forward_kinematics.poses(result.joint_positions[np.newaxis])[0]
        distance, angle = pose_distance(target, achieved)
        assert max(distance, angle) <= 1e-6
        solved += 1
    assert solved >= 995
