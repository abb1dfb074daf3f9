"""The paper's design of experiments: 30 phases of joints swept alone and together, Table 1."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.grid import distinct_rows, grid_positions
from annik_training.errors import UnsupportedRobot

_MIN, _MED, _MAX = 0, 1, 2
_BLOCK_SIZES = (2, 3, 4)


class Phase(NamedTuple):
    """Joints swept together over z = 0..j, eq. (5), while the others are held."""

    swept: tuple[int, ...]  #: indices of the joints that move
    held_at: int  #: where the others are, in halves of their range: 0 min, 1 median, 2 max


def phases(dof: int) -> list[Phase]:
    """The phases for a number of joints, in the order of Table 1; 30 of them for six joints.

    - Each joint alone, the others at min, at median, at max: phases 1-18.
    - The others at median: blocks of two, three and four neighbouring joints, the last block
      moved back where the joints don't divide evenly, then all joints: phases 19-26.
    - Every second joint, the first one included, the others at min, then at max; the same for the
      remaining joints: phases 27-30.

    With six joints this is exactly Table 1; for other numbers it extends the same rule. With fewer
    than five joints a block of all joints is left out: the phase with all joints exists anyway.
    """
    joints = tuple(range(dof))
    table = [Phase((joint,), held_at) for held_at in (_MIN, _MED, _MAX) for joint in joints]
    for size in _BLOCK_SIZES:
        if size < dof:
            starts = [min(start, dof - size) for start in range(0, dof, size)]
            table += [Phase(joints[start : start + size], _MED) for start in starts]
    if dof > 1:
        table.append(Phase(joints, _MED))
        for half in (joints[0::2], joints[1::2]):
            if len(half) > 1:
                table += [Phase(half, _MIN), Phase(half, _MAX)]
    return table


def thirty_phase_design(
    box: JointLimits, steps: int, *, keep_paper_rows: bool = False
) -> FloatArray:
    """Joint positions of the paper's design.

    Args:
        box: the joint box; every joint sweeps all of its interval.
        steps: j of eq. (6), the number of steps p of each sweep.
        keep_paper_rows: keep the repeated rows that the paper keeps, and drop the end points that
            it drops. This gives its 104 and 194 rows (Table 7) for j = 3 and 6, instead of the 102
            and 179 distinct ones. Six joints only.

    Returns:
        ``(n, dof)`` in the order of Table 1; by default without repeated rows.

    Raises:
        UnsupportedRobot: if the paper's rows are asked for other than six joints.
    """
    dof = len(box.joint_names)
    if not keep_paper_rows:
        return distinct_positions(phases(dof), box, steps)
    if dof != 6:
        raise UnsupportedRobot("--paper-rows", f"{dof} joints", "the paper's robot has six")
    rows = np.concatenate(
        [
            half_steps(phase, dof, steps)[_paper_rows(number, steps)]
            for number, phase in enumerate(phases(dof), start=1)
        ]
    )
    return grid_positions(rows, box, steps)


def distinct_positions(table: Sequence[Phase], box: JointLimits, steps: int) -> FloatArray:
    """Joint positions ``(n, dof)`` of phases; a repeated row is kept where it first occurs."""
    rows = np.concatenate([half_steps(phase, len(box.joint_names), steps) for phase in table])
    return grid_positions(distinct_rows(rows), box, steps)


def half_steps(phase: Phase, dof: int, steps: int) -> NDArray[np.int64]:
    """Rows of a phase ``(steps + 1, dof)`` in half steps from the minimum.

    Integers, so that equal rows are found exactly; half steps, because the median of an odd number
    of steps is between two steps.
    """
    rows = np.full((steps + 1, dof), phase.held_at * steps, dtype=np.int64)
    rows[:, phase.swept] = 2 * np.arange(steps + 1)[:, np.newaxis]
    return rows


def _paper_rows(phase_number: int, steps: int) -> slice:
    """The z = 0..j that the paper's tables list for a phase, by its counts and rows."""
    without_first = {2, 3, 4, 5, 6, 26, 27, 29}
    without_last = {13, 14, 15, 16, 17, 26, 28, 30}
    return slice(
        1 if phase_number in without_first else 0,
        steps if phase_number in without_last else steps + 1,
    )
