"""The paper's design, repaired: with the phases that make every two-joint interaction visible.

On the paper's examples some products of joint differences, such as (q1 - q2)(q4 - q6), are zero
everywhere, whatever the number of steps: a robot whose pose depends on one of them can't be
learned from these examples. Sweeping a few more pairs of joints together ends that.
"""

from __future__ import annotations

from itertools import combinations

from annik_core.joint_limits import JointLimits
from annik_core.pose import FloatArray
from annik_training.quadratic_model import quadratic_rank, quadratic_terms
from annik_training.thirty_phase_design import (
    Phase,
    check_steps,
    distinct_rows,
    half_steps,
    phases,
)

NAME = "thirty_phase_plus"

_MEDIAN = 1
#: Two steps already tell which products vanish; more only add rows to the same answer.
_STEPS_TO_SEE = 2


def interaction_phases(dof: int) -> list[Phase]:
    """The phases to add for a number of joints; for six, the pairs 1,3 1,4 1,5 2,5.

    Pairs are swept together with the other joints at their medians, and are tried in order; one is
    taken if the full quadratic model of the joint positions gains rank by it, until none is blind.
    """
    table = phases(dof)
    added: list[Phase] = []
    rank = _rank(table, dof)
    for pair in combinations(range(dof), 2):
        if rank == len(quadratic_terms(dof)):
            break
        candidate = Phase(pair, _MEDIAN)
        with_candidate = _rank([*table, *added, candidate], dof)
        if with_candidate > rank:
            added.append(candidate)
            rank = with_candidate
    return added


def thirty_phase_plus_design(box: JointLimits, steps: int) -> FloatArray:
    """Joint positions ``(n, dof)`` of the repaired design, without repeated rows.

    Args:
        box: the joint box.
        steps: j of eq. (6), the steps of each sweep.

    Raises:
        InvalidDesignSize: if ``steps`` is out of range.
    """
    check_steps(NAME, steps)
    dof = len(box.joint_names)
    return distinct_rows([*phases(dof), *interaction_phases(dof)], box, steps)


def _rank(table: list[Phase], dof: int) -> int:
    return quadratic_rank(
        [row for phase in table for row in half_steps(phase, dof, _STEPS_TO_SEE).tolist()]
    )
