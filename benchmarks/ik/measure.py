"""Each target to each solver in turn: what they answer, and how long that takes.

All targets are gone through several times, one round after another. The answers of the first time
count. The time of a target is the median of its calls: one that the system interrupted, to run
something else, says nothing of the solver. What the single calls took is in the data beside it.
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
from benchmarks.ik.query import Clock, ask, balanced_order, no_garbage_collection, tidy_up
from benchmarks.ik.verification import Verifier

#: Targets between two times that Python tidies up.
_TIDY_EVERY = 50


@dataclass(frozen=True)
class TargetResult:
    """How one solver did on the targets.

    Attributes:
        targets: how many there were.
        answered: fraction that the solver itself says it solved.
        success: fraction that it did solve, by the independent forward kinematics.
        in_limits: fraction solved within the limits of the joints.
        in_box: fraction solved within the working box, on the branch that is asked for.
        median_us: time of the usual target [us]; of all targets, those that it failed on too.
        p99_us: 99 of 100 targets take at most so long [us].
        worst_us: the target that takes longest [us].
        single_p99_us: 99 of 100 single calls take at most so long, interrupted or not [us].
        single_worst_us: the longest single call [us].
        faults: exceptions and answers that are none, each with how often.
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
        """How much longer the slow targets take than the usual one."""
        return self.p99_us / self.median_us

    def as_plain_data(self) -> dict[str, Any]:
        """For JSON; the units are in the names."""
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
    """Ask all solvers for all targets, interleaved in one run, and verify the answers.

    Whatever slows the machine down for a while so slows all of them.

    Args:
        solvers: whom to ask; their names differ.
        poses: ``(n, 7)``.
        warm_up: ``(m, 7)``, asked first; answers and times don't count.
        verifier: of the problem that the solvers were made for.
        rounds: how often to go through all targets.
        on_target: told how many targets are done, of ``rounds * n``.
        clock: what times are taken by [ns].

    Returns:
        By the solvers' names.
    """
    dof = len(verifier.problem.joint_names)
    answers = np.full((len(solvers), len(poses), dof), np.nan)
    times = np.empty((len(solvers), rounds, len(poses)))
    faults: list[Counter[str]] = [Counter() for _ in solvers]
    with no_garbage_collection():
        for pose in warm_up:
            for solver in solvers:
                ask(solver, pose, dof)
        for done in range(rounds * len(poses)):
            if done % _TIDY_EVERY == 0:
                tidy_up()
            repetition, row = divmod(done, len(poses))
            # In another order each time, so that its calls come after different solvers.
            for number in balanced_order(len(solvers), row + repetition):
                asked = ask(solvers[number], poses[row], dof, clock)
                times[number, repetition, row] = asked.nanoseconds
                if repetition > 0:
                    continue
                if asked.joint_positions is not None:
                    answers[number, row] = asked.joint_positions
                if asked.fault:
                    faults[number][asked.fault] += 1
            on_target(done + 1)
    return {
        solver.name: _result(answers[number], times[number], poses, verifier, faults[number])
        for number, solver in enumerate(solvers)
    }


def _result(
    answers: FloatArray,
    nanoseconds: FloatArray,
    poses: FloatArray,
    verifier: Verifier,
    faults: Mapping[str, int],
) -> TargetResult:
    verified = verifier.verified(answers, poses)
    microseconds = 1e-3 * np.median(nanoseconds, axis=0)
    median, p99 = np.percentile(microseconds, [50, 99])
    return TargetResult(
        targets=len(poses),
        answered=float(np.isfinite(answers[:, 0]).mean()),
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
