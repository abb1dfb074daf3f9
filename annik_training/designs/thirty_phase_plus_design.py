"""The paper's design with more phases, so that every interaction of two joints can be identified.

On the paper's examples some products of joint differences, such as (q1 - q2)(q4 - q6), are zero
for any number of steps. A robot whose pose depends on such a product can't be learned from them.
"""

from functools import cache
from itertools import combinations

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.quadratic_model import term_values, vanishing_combinations
from annik_training.designs.thirty_phase_design import (
    Phase,
    distinct_positions,
    half_steps,
    phases,
)

_MEDIAN = 1
#: On a phase, a line in joint space, a quadratic that is zero at three points is zero everywhere.
#: Two steps therefore show what any larger number shows.
_STEPS_TO_SEE = 2


@cache
def interaction_phases(dof: int) -> tuple[Phase, ...]:
    """The phases to add for a number of joints; for six, the pairs 1,3 1,4 1,5 2,5.

    Each pair is swept together with the other joints at their medians. Pairs are tried in order;
    one is added if a quadratic that vanishes on all phases so far does not vanish on it.
    """
    added: list[Phase] = []
    vanishing = vanishing_combinations(_rows(phases(dof), dof))
    for pair in combinations(range(dof), 2):
        if vanishing.shape[0] == 0:
            break
        candidate = Phase(pair, _MEDIAN)
        shown = vanishing * term_values(_rows([candidate], dof)).transpose()
        if not shown.is_zero_matrix:
            added.append(candidate)
            # The sums of multiples of its rows that are zero.
            vanishing = shown.transpose().nullspace() * vanishing
    return tuple(added)


def thirty_phase_plus_design(box: JointLimits, steps: int) -> FloatArray:
    """Joint positions ``(n, dof)`` [rad or m] of the repaired design, without repeated rows.

    ``steps`` is j of eq. (6), the steps of each sweep.
    """
    dof = len(box.joint_names)
    return distinct_positions([*phases(dof), *interaction_phases(dof)], box, steps)


def _rows(table: list[Phase], dof: int) -> list[list[int]]:
    return [row for phase in table for row in half_steps(phase, dof, _STEPS_TO_SEE).tolist()]
