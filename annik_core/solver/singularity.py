"""Across a fold of the inverse kinematics: from one solution's neighbourhood to the other's.

Where the Jacobian loses rank two solutions of one pose meet, as the two halves of a sheet of paper
meet at its fold. Between them lies the singularity, at which the least singular value sigma of the
Jacobian is zero, and its right singular vector v is the direction that leads across. A search that
began on the wrong side ends at the fold, or at a limit before it, and does not cross it by itself.
Not every singularity is a fold: at a wrist's, two axes are in line, the direction v only turns
their joints against each other, and there is nothing to cross.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray

#: Step of the finite difference of the Jacobian along v [rad or m].
_STEP = 1e-4
#: How far to go, in distances to the fold: 2 is the mirror image, if both sides were alike. Short
#: of it the search falls back; beyond it, it comes back to the solution on that side.
_DISTANCES = 3.0
#: Never farther than this [rad or m]: the distance is a linear guess.
_FARTHEST = 1.5
#: Change of sigma along v below which no fold is in that direction [per rad or m].
_LEAST_SLOPE = 1e-9


def reflected_across_singularity(
    jacobian: Callable[[FloatArray], FloatArray],
    joint_positions: FloatArray,
    free: NDArray[np.int64],
) -> FloatArray:
    """Joint positions ``(dof,)`` beyond the nearest fold.

    With sigma = u^T J v, the fold is about sigma / (u^T (dJ/dv) v) away along -v.

    Args:
        jacobian: ``(dof,)`` to ``(6, dof)``.
        joint_positions: ``(dof,)`` where to look from.
        free: indices of the joints that may move.
    """
    left, singular, right = np.linalg.svd(jacobian(joint_positions)[:, free], full_matrices=False)
    across = np.zeros_like(joint_positions)
    across[free] = right[-1]
    ahead, behind = (
        jacobian(joint_positions + side * _STEP * across)[:, free] for side in (1.0, -1.0)
    )
    slope = float(left[:, -1] @ (ahead - behind) @ right[-1]) / (2.0 * _STEP)
    if abs(slope) < _LEAST_SLOPE:
        return joint_positions
    distance = -_DISTANCES * float(singular[-1]) / slope
    beyond: FloatArray = joint_positions + max(-_FARTHEST, min(_FARTHEST, distance)) * across
    return beyond
