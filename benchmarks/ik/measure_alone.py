"""Times of each solver alone, while its code and data stay in the processor's caches.

Interleaved with ten others, each call finds in the caches what the others left. A node is between
the two: it runs one solver, and the middleware between two solves.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Peer
from benchmarks.ik.query import Clock, no_garbage_collection, timed_solve

#: Targets in a row by one solver; then comes the next, so that other load slows all of them.
BLOCK = 100
#: Calls before each block that don't count.
_WARM_UP = 10


@dataclass(frozen=True)
class AloneResult:
    """Times of single calls, interrupted or not.

    Attributes:
        median_us: of the calls [us].
        p99_us: 99th percentile [us].
        fastest_tenth_us: 10th percentile [us]; on a shared machine the nearest to an idle one.
    """

    median_us: float
    p99_us: float
    fastest_tenth_us: float

    @property
    def p99_over_median(self) -> float:
        """Ratio of the slow calls to the median one."""
        return self.p99_us / self.median_us

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; the units are in the names."""
        return {**asdict(self), "p99_over_median": self.p99_over_median}


def measure_alone(
    solvers: Sequence[Peer],
    poses: FloatArray,
    dof: int,
    on_target: Callable[[int], None] = lambda done: None,
    clock: Clock = time.perf_counter_ns,
) -> dict[str, AloneResult]:
    """Solve many targets in a row with each solver, block by block.

    Args:
        solvers: with different names.
        poses: ``(n, 7)``.
        dof: number of joints of a solution.
        on_target: called with the number of finished targets, of ``n``.
        clock: gives the time [ns].

    Returns:
        By the solvers' names.
    """
    times = np.empty((len(solvers), len(poses)))
    with no_garbage_collection():
        for begin in range(0, len(poses), BLOCK):
            block = poses[begin : begin + BLOCK]
            for number, solver in enumerate(solvers):
                for pose in block[:_WARM_UP]:
                    timed_solve(solver, pose, dof)
                for row, pose in enumerate(block, start=begin):
                    times[number, row] = timed_solve(solver, pose, dof, clock).nanoseconds
            on_target(begin + len(block))
    return {
        solver.name: AloneResult(*(1e-3 * np.percentile(of_solver, [50, 99, 10])).tolist())
        for solver, of_solver in zip(solvers, times, strict=True)
    }
