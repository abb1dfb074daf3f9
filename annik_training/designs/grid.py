"""Joint positions on a grid, counted in half steps so that equal ones are found exactly."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits


def grid_positions(half_steps: NDArray[np.int64], box: JointLimits, steps: int) -> FloatArray:
    """Joint positions ``(n, dof)`` [rad or m] of a grid that divides every joint into equal steps.

    The half steps ``(n, dof)`` are from 0, the lower end, to ``2 * steps``, the upper end. With
    half steps the median is on the grid for any number of steps.
    """
    inside = box.lower + half_steps / (2.0 * steps) * (box.upper - box.lower)
    # Rounding would miss the upper end, on either side of it.
    positions: FloatArray = np.where(half_steps == 2 * steps, box.upper, inside)
    return positions


def distinct_rows(rows: NDArray[Any]) -> NDArray[Any]:
    """Rows ``(n, k)`` without repeats, each where it first occurs."""
    _, first = np.unique(rows, axis=0, return_index=True)
    return rows[np.sort(first)]
