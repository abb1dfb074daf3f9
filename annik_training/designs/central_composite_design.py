"""The central composite of response-surface methodology: corners, face centres and the centre.

It is the classic design for a full quadratic model, Box and Wilson 1951, here with the axial
points on the faces of the joint box ("face-centred"), since a robot can't go outside. The nested
shells are an extension, for what needs more than three positions of a joint.

References:
    G. E. P. Box and K. B. Wilson, "On the Experimental Attainment of Optimum Conditions", Journal
    of the Royal Statistical Society, Series B, 13 (1), 1951, pages 1-45.
"""

from __future__ import annotations

import itertools

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.errors import InvalidDesignSize, UnsupportedRobotForDesign
from annik_training.designs.grid import distinct_rows, grid_positions

NAME = "central_composite"
MAX_SHELLS = 100
#: A shell has 2 to the power of the number of joints corners: 1024 of them here.
MAX_JOINTS = 10


def central_composite_design(box: JointLimits, shells: int) -> FloatArray:
    """Joint positions of the centre, and of the corners and face centres of nested boxes.

    Args:
        box: the joint box.
        shells: how many boxes, about the centre of the joint box and s / shells as wide as it, s =
            1..shells. One is the classic design.

    Returns:
        ``(shells (2^dof + 2 dof) + 1, dof)`` [rad or m]: the centre, then the boxes from the
        outermost inwards, of each the corners and then the face centres. A single joint's corners
        are its face centres, and are there once.

    Raises:
        InvalidDesignSize: if ``shells`` is out of range.
        UnsupportedRobotForDesign: if there are more than ten joints.
    """
    dof = len(box.joint_names)
    if not 1 <= shells <= MAX_SHELLS:
        raise InvalidDesignSize(NAME, "shells", shells, 1, MAX_SHELLS)
    if dof > MAX_JOINTS:
        raise UnsupportedRobotForDesign(
            NAME, f"with {dof} joints", f"each shell would have 2^{dof} corners; at most 2^10"
        )
    corners = np.array(list(itertools.product((-1, 1), repeat=dof)))
    along_axes = np.eye(dof, dtype=np.int64)
    shell = np.concatenate([corners, -along_axes, along_axes])
    centre = np.zeros((1, dof), dtype=np.int64)
    from_centre = np.concatenate([centre, *(scale * shell for scale in range(shells, 0, -1))])
    return grid_positions(shells + distinct_rows(from_centre), box, shells)
