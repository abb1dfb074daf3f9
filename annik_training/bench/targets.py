"""Random targets of which it is known that the working joint box holds a solution."""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robot import Robot


def random_configurations(robot: Robot, count: int, rng: np.random.Generator) -> FloatArray:
    """Joint positions ``(count, dof)``, uniform in the working box [rad or m]."""
    box = robot.joint_box
    return rng.uniform(box.lower, box.upper, (count, robot.dof))


def random_targets(robot: Robot, count: int, rng: np.random.Generator) -> FloatArray:
    """Poses ``(count, 7)`` of random configurations; the configurations are not given out."""
    return robot.forward_kinematics.poses(random_configurations(robot, count, rng))
