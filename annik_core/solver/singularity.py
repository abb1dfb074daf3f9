"""Reflection across a singularity, from one branch of the inverse kinematics to the other.

Two branches meet where the least singular value sigma of the Jacobian is zero; the right singular
vector v is the direction across. A search that began on the wrong branch ends at the singularity,
or at a limit before it, and does not cross it by itself. Not every singularity separates branches:
where two wrist axes are aligned, v only turns their joints against each other.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray

#: Step of the finite difference of the Jacobian along v [rad or m].
_STEP = 1e-4
#: Length of the reflection, in distances to the singularity. The mirror image, at 2, may be too
#: short; from beyond it, a search still finds the solution on that branch.
_DISTANCES = 3.0
#: Greatest length of the reflection [rad or m], since the distance is a linear estimate.
_FARTHEST = 1.5
#: Derivative of sigma along v below which no singularity is in that direction [per rad or m].
_LEAST_DERIVATIVE = 1e-9


def reflected_across_singularity(
    jacobian: Callable[[FloatArray], FloatArray],
    joint_positions: FloatArray,
    free: NDArray[np.int64],
) -> FloatArray:
    """Joint positions ``(dof,)`` beyond the nearest singularity; the same if there is none.

    With sigma = u^T J v, the singularity is about sigma / (u^T (dJ/dv) v) away along -v. Only the
    joints with indices in ``free`` move.
    """
    left, singular, right = np.linalg.svd(jacobian(joint_positions)[:, free], full_matrices=False)
    across = np.zeros_like(joint_positions)
    across[free] = right[-1]
    ahead, behind = (
        jacobian(joint_positions + side * _STEP * across)[:, free] for side in (1.0, -1.0)
    )
    derivative = float(left[:, -1] @ (ahead - behind) @ right[-1]) / (2.0 * _STEP)
    if abs(derivative) < _LEAST_DERIVATIVE:
        return joint_positions
    distance = -_DISTANCES * float(singular[-1]) / derivative
    beyond: FloatArray = joint_positions + max(-_FARTHEST, min(_FARTHEST, distance)) * across
    return beyond
