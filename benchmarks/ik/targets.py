"""Random targets of which it is known that the working joint box holds a solution."""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot


def random_targets(robot: Robot, count: int, rng: np.random.Generator) -> FloatArray:
    """Poses ``(count, 7)`` of random configurations; the configurations are not given out."""
    return robot.forward_kinematics.poses(robot.joint_box.sample(count, rng))
