"""The central composite of response-surface methodology: corners, face centres and the centre.

The classic design for a full quadratic model (Box and Wilson 1951), face-centred: a robot can't
leave its joint box. Nested shells are an extension, for more than three positions of each joint.

References:
    G. E. P. Box and K. B. Wilson, "On the Experimental Attainment of Optimum Conditions", Journal
    of the Royal Statistical Society, Series B, 13 (1), 1951, pages 1-45.
"""

import itertools

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.grid import distinct_rows, grid_positions
from annik_training.errors import UnsupportedRobot

#: A shell has 2^joints corners: here 1024.
MAX_JOINTS = 10


def central_composite_design(box: JointLimits, shells: int) -> FloatArray:
    """Joint positions of the centre, and of the corners and face centres of nested boxes.

    Box s = 1..shells is s / shells as wide as the joint box and has the same centre; one is the
    classic design.

    Returns:
        ``(shells (2^dof + 2 dof) + 1, dof)`` [rad or m]: the centre, then the boxes from the
        outermost inwards, each with its corners and then its face centres. With one joint the
        corners are the face centres, and occur once.

    Raises:
        UnsupportedRobot: if there are more than ten joints.
    """
    dof = len(box.joint_names)
    if dof > MAX_JOINTS:
        raise UnsupportedRobot(
            "design central_composite",
            f"{dof} joints",
            f"each shell would have 2^{dof} corners; at most 2^{MAX_JOINTS}",
        )
    corners = np.array(list(itertools.product((-1, 1), repeat=dof)))
    along_axes = np.eye(dof, dtype=np.int64)
    shell = np.concatenate([corners, -along_axes, along_axes])
    centre = np.zeros((1, dof), dtype=np.int64)
    from_centre = np.concatenate([centre, *(scale * shell for scale in range(shells, 0, -1))])
    return grid_positions(shells + distinct_rows(from_centre), box, shells)
