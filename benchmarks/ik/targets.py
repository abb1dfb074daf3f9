"""Random targets that have a solution in the joint box."""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot


def random_targets(robot: Robot, count: int, rng: np.random.Generator) -> FloatArray:
    """Poses ``(count, 7)`` of random configurations; of the joint box."""
    return robot.forward_kinematics.poses(robot.joint_box.sample(count, rng))
