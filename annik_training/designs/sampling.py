"""Examples that are computed: joint positions of a design, poses of the forward kinematics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from annik_core.dataset import Dataset
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.designs.registry import make_design


def compute_dataset(
    robot: Robot, design: str, size: int, seed: int, options: Mapping[str, Any] | None = None
) -> Dataset:
    """Examples of a design, with the poses from the robot's forward kinematics.

    Args:
        robot: the robot.
        design: name of a registered design.
        size: its size; see the design's ``size_means``.
        seed: what a random design draws from.
        options: the design's own options.

    Raises:
        DesignError: if the design can't be made like this.
    """
    joint_positions = make_design(design, robot, size, seed, options)
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, design, {"size": size, **(options or {})}, seed)


def compute_random_dataset(robot: Robot, box: JointLimits, examples: int, seed: int) -> Dataset:
    """Uniformly random joint positions in a box, for evaluation."""
    joint_positions = box.sample(examples, np.random.default_rng(seed))
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, "random", {"size": examples}, seed)
