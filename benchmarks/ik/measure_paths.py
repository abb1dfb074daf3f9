"""Continuity of each solver's solutions along straight paths.

In a joint box, the solvers are not given the previous solution: the question is whether their
solution is a continuous function of the pose. On a whole robot, where it can't be, they follow:
each is given its own previous solution. Steps are taken between the solutions as returned, right
or wrong; where there is none, the next one is compared with the last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Peer
from benchmarks.ik.query import no_garbage_collection, timed_solve
from benchmarks.ik.straight_paths import StraightPath
from benchmarks.ik.verification import Verifier

#: A branch change: a step that is larger than the reference's largest by this factor
FACTOR = 1.5
#: and by this much [rad or m].
MARGIN = 0.02


@dataclass(frozen=True)
class PathResult:
    """How one solver did on the paths.

    Attributes:
        paths: how many there were.
        solved: paths of which every point was solved, by the independent forward kinematics;
            where they are followed, within the limits.
        changing: paths with a branch change: a joint step of more than :data:`FACTOR` times the
            largest of the path's own continuous solution, and :data:`MARGIN` more than it.
        largest_step: of a joint from one point to the next, on all paths [rad or m].
        largest_ratio: greatest ratio of the largest step on a path to that of its own solution.
    """

    paths: int
    solved: int
    changing: int
    largest_step: float
    largest_ratio: float


@dataclass(frozen=True)
class _OnePath:
    solved: bool
    changes: bool
    largest_step: float
    ratio: float


def measure_paths(
    solvers: Sequence[Peer],
    paths: Sequence[StraightPath],
    verifier: Verifier,
    on_path: Callable[[int], None] = lambda done: None,
    *,
    follow: bool = False,
) -> dict[str, PathResult]:
    """Let all solvers follow all paths.

    Args:
        solvers: with different names.
        paths: at least one.
        verifier: of the problem that the solvers were made for.
        on_path: called with the number of finished paths.
        follow: whether each solver is given its previous solution, at first the path's own.

    Returns:
        By the solvers' names.
    """
    found: dict[str, list[_OnePath]] = {solver.name: [] for solver in solvers}
    for done, path in enumerate(paths, start=1):
        with no_garbage_collection():
            for solver in solvers:
                found[solver.name].append(_one_path(solver, path, verifier, follow))
        on_path(done)
    return {
        name: PathResult(
            paths=len(of_solver),
            solved=sum(one.solved for one in of_solver),
            changing=sum(one.changes for one in of_solver),
            largest_step=max(one.largest_step for one in of_solver),
            largest_ratio=max(one.ratio for one in of_solver),
        )
        for name, of_solver in found.items()
    }


def _one_path(solver: Peer, path: StraightPath, verifier: Verifier, follow: bool) -> _OnePath:
    solutions = np.full_like(path.joint_positions, np.nan)
    dof = len(verifier.problem.joint_names)
    previous = path.joint_positions[0] if follow else None
    for row, pose in enumerate(path.poses):
        solution = timed_solve(solver, pose, dof, start=previous).joint_positions
        if solution is not None:
            solutions[row] = solution
            previous = solution if follow else None
    verified = verifier.verified(solutions, path.poses)
    solved = bool((verified.in_limits if follow else verified.right).all())
    return _OnePath(solved, *_spread(solutions, path, verifier))


def _spread(
    solutions: FloatArray, path: StraightPath, verifier: Verifier
) -> tuple[bool, float, float]:
    """Whether solutions ``(points, dof)`` change the branch; largest step; its ratio."""
    solved = np.flatnonzero(np.isfinite(solutions[:, 0]))
    if len(solved) < 2:
        return False, 0.0, 0.0
    steps = verifier.steps(solutions[solved[:-1]], solutions[solved[1:]])
    points = np.diff(solved)
    usual = path.largest_step
    changes = bool((steps > points * max(FACTOR * usual, usual + MARGIN)).any())
    next_to_each_other = steps[points == 1]
    largest = float(next_to_each_other.max()) if len(next_to_each_other) else 0.0
    return changes, largest, largest / usual
