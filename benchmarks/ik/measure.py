"""Success and time of every solver on the same targets, interleaved.

All targets are solved in several rounds; the solutions of the first one count. The time of a
target is the median of its calls, so that a call that the system interrupted does not count. The
times of the single calls are in the data.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Peer
from benchmarks.ik.query import (
    Clock,
    balanced_order,
    collect_garbage,
    no_garbage_collection,
    timed_solve,
)
from benchmarks.ik.verification import Verifier

#: Targets between two collections of Python's garbage.
_COLLECT_EVERY = 50


@dataclass(frozen=True)
class TargetResult:
    """How one solver did on the targets.

    Attributes:
        targets: how many there were.
        answered: fraction that the solver itself reports as solved.
        success: fraction solved, by the independent forward kinematics.
        in_limits: fraction solved within the limits of the joints.
        in_box: fraction solved within the joint box, on the branch of the targets.
        median_us: time of a target, failed ones included [us].
        p99_us: likewise, 99th percentile [us].
        worst_us: likewise, longest [us].
        single_p99_us: 99th percentile of the single calls, interrupted or not [us].
        single_worst_us: the longest single call [us].
        faults: exceptions and unusable return values, each with how often.
    """

    targets: int
    answered: float
    success: float
    in_limits: float
    in_box: float
    median_us: float
    p99_us: float
    worst_us: float
    single_p99_us: float
    single_worst_us: float
    faults: Mapping[str, int]

    @property
    def p99_over_median(self) -> float:
        """Ratio of the slow targets to the median one."""
        return self.p99_us / self.median_us

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; the units are in the names."""
        return {**asdict(self), "p99_over_median": self.p99_over_median}


def measure_targets(
    solvers: Sequence[Peer],
    poses: FloatArray,
    warm_up: FloatArray,
    verifier: Verifier,
    rounds: int = 3,
    on_target: Callable[[int], None] = lambda done: None,
    clock: Clock = time.perf_counter_ns,
) -> dict[str, TargetResult]:
    """Solve all targets with all solvers, interleaved in one run, and verify the solutions.

    Interleaved, so that other load on the machine slows all of them.

    Args:
        solvers: with different names.
        poses: ``(n, 7)``.
        warm_up: ``(m, 7)``, solved first; solutions and times don't count.
        verifier: of the problem that the solvers were made for.
        rounds: how often to go through all targets.
        on_target: called with the number of finished targets, of ``rounds * n``.
        clock: gives the time [ns].

    Returns:
        By the solvers' names.
    """
    dof = len(verifier.problem.joint_names)
    solutions = np.full((len(solvers), len(poses), dof), np.nan)
    times = np.empty((len(solvers), rounds, len(poses)))
    faults: list[Counter[str]] = [Counter() for _ in solvers]
    with no_garbage_collection():
        for pose in warm_up:
            for solver in solvers:
                timed_solve(solver, pose, dof)
        for done in range(rounds * len(poses)):
            if done % _COLLECT_EVERY == 0:
                collect_garbage()
            repetition, row = divmod(done, len(poses))
            # Another order each time: a solver's calls follow different solvers.
            for number in balanced_order(len(solvers), row + repetition):
                solved = timed_solve(solvers[number], poses[row], dof, clock)
                times[number, repetition, row] = solved.nanoseconds
                if repetition > 0:
                    continue
                if solved.joint_positions is not None:
                    solutions[number, row] = solved.joint_positions
                if solved.fault:
                    faults[number][solved.fault] += 1
            on_target(done + 1)
    return {
        solver.name: _result(solutions[number], times[number], poses, verifier, faults[number])
        for number, solver in enumerate(solvers)
    }


def _result(
    solutions: FloatArray,
    nanoseconds: FloatArray,
    poses: FloatArray,
    verifier: Verifier,
    faults: Mapping[str, int],
) -> TargetResult:
    verified = verifier.verified(solutions, poses)
    microseconds = 1e-3 * np.median(nanoseconds, axis=0)
    median, p99 = np.percentile(microseconds, [50, 99])
    return TargetResult(
        targets=len(poses),
        answered=float(np.isfinite(solutions[:, 0]).mean()),
        success=float(verified.right.mean()),
        in_limits=float(verified.in_limits.mean()),
        in_box=float(verified.in_box.mean()),
        median_us=float(median),
        p99_us=float(p99),
        worst_us=float(microseconds.max()),
        single_p99_us=float(1e-3 * np.percentile(nanoseconds, 99)),
        single_worst_us=float(1e-3 * nanoseconds.max()),
        faults=dict(faults),
    )
