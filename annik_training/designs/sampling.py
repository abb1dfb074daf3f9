"""Datasets that are computed: joint positions of a design, poses by the forward kinematics."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from annik_core.dataset import Dataset
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.designs.registry import make_design


def generate_dataset(
    robot: Robot, design: str, size: int, seed: int = 0, options: Mapping[str, Any] | None = None
) -> Dataset:
    """Examples of a design of experiments, with the poses of the robot's forward kinematics.

    Arguments and errors are those of :func:`annik_training.make_design`.
    """
    joint_positions = make_design(robot, design, size, seed, options)
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, design, {"size": size, **(options or {})}, seed)


def random_dataset(robot: Robot, box: JointLimits, examples: int, seed: int) -> Dataset:
    """Uniformly random joint positions in a box, for evaluation."""
    joint_positions = box.sample(examples, np.random.default_rng(seed))
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, "random", {"size": examples}, seed)
