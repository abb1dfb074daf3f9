"""Joints that a design of experiments moves: locked joints (zero width) are excluded."""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits


def free_box(box: JointLimits) -> JointLimits:
    """Joint box of the joints that are not locked."""
    free = box.free
    names = [box.joint_names[joint] for joint in free]
    return JointLimits.from_bounds(names, box.lower[free], box.upper[free])


def with_locked_joints(joint_positions: FloatArray, box: JointLimits) -> FloatArray:
    """Positions of all joints ``(n, dof)`` from those of the free joints ``(n, free)``."""
    complete = np.tile(box.lower, (len(joint_positions), 1))
    complete[:, box.free] = joint_positions
    return complete
