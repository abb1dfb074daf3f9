"""Joints that a design of experiments can move: a locked joint, of zero width, is none of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from annik_core.joint_limits import JointLimits
from annik_core.pose import FloatArray


def free_joints(box: JointLimits) -> NDArray[np.intp]:
    """Columns of the joints that are not locked, in order."""
    return np.flatnonzero(box.upper > box.lower)


def free_box(box: JointLimits) -> JointLimits:
    """The box of the joints that are not locked."""
    free = free_joints(box)
    names = [box.joint_names[joint] for joint in free]
    return JointLimits.from_bounds(names, box.lower[free], box.upper[free])


def with_locked_joints(joint_positions: FloatArray, box: JointLimits) -> FloatArray:
    """Positions of all joints ``(n, dof)`` from those of the free ones ``(n, free)``."""
    complete = np.tile(box.lower, (len(joint_positions), 1))
    complete[:, free_joints(box)] = joint_positions
    return complete
