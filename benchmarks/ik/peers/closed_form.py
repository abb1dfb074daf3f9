"""The choice among the solutions that a closed form finds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.problem import IkProblem

TURN = 2.0 * math.pi

#: How far outside the box [rad] counts as inside: rounding in a solution on the edge.
EDGE = 1e-6


#: How far a solution marked as approximate may lead from its pose [m, entries of the rotation].
EXACT = 1e-7


def exact_solutions(
    solutions: Sequence[tuple[list[float], bool]],
    forward: Callable[[list[float]], FloatArray],
    target: FloatArray,
) -> list[list[float]]:
    """The solutions that are not approximate.

    Args:
        solutions: each with whether the solver marks it as a least-squares solution.
        forward: the solver's forward kinematics, joint positions to ``(4, 4)``.
        target: ``(4, 4)``.

    Returns:
        Those not marked. If all are marked, those that lead to the target all the same.
    """
    exact = [positions for positions, marked in solutions if not marked]
    return exact or [
        positions
        for positions, _ in solutions
        if np.abs(forward(positions) - target).max() < EXACT
    ]


def chosen_solution(
    solutions: Sequence[Sequence[float]], problem: IkProblem, start: FloatArray | None = None
) -> FloatArray:
    """The solution in the joint box that is nearest to the start, else the nearest of all.

    Each angle is first turned by whole turns to the one nearest to the start that is in the box,
    because a closed form knows angles only within a turn.

    In plain numbers, because it is timed with each solve: on eight solutions of six angles numpy
    takes several times as long as the closed form itself.

    Args:
        solutions: at least one, each ``(free,)`` angles [rad].
        problem: with the box.
        start: ``(dof,)``; by default that of the problem.

    Returns:
        ``(dof,)`` [rad].
    """
    begin = problem.free_of(start)
    centres = begin.tolist()
    inside = []
    for solution in solutions:
        offsets = []
        for angle, centre, (low, high) in zip(solution, centres, problem.free_bounds, strict=True):
            offset = math.remainder(angle - centre, TURN)
            if centre + offset > high + EDGE:
                offset -= TURN
            elif centre + offset < low - EDGE:
                offset += TURN
            if not low - EDGE <= centre + offset <= high + EDGE:
                break
            offsets.append(offset)
        else:
            inside.append(offsets)
    if not inside:
        inside = [
            [
                math.remainder(angle - centre, TURN)
                for angle, centre in zip(solution, centres, strict=True)
            ]
            for solution in solutions
        ]
    nearest = inside[0] if len(inside) == 1 else min(inside, key=_square)
    return problem.with_locked(begin + np.array(nearest))


def _square(offsets: Sequence[float]) -> float:
    """Of the distance."""
    return sum(offset * offset for offset in offsets)
