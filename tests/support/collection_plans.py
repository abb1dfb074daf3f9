"""Small plans of examples, for the tests of collecting. ROS-free."""

from __future__ import annotations

import numpy as np

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot


def plan_at(robot: Robot, joint_positions: FloatArray) -> Dataset:
    """A plan with these joint positions ``(n, dof)``."""
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, "random", {"size": len(poses)}, 0)


def small_plan(robot: Robot, examples: int = 5, seed: int = 0) -> Dataset:
    """A plan of random joint positions inside the joint box."""
    return plan_at(robot, robot.joint_box.sample(examples, np.random.default_rng(seed)))
