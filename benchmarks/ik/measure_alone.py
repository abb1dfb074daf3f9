"""How long a solver takes when nothing else runs in between: its code and data stay in the caches.

In turn with ten others, each call begins with what the others left there. A node is between the
two: it runs one solver, with the middleware in between.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Peer
from benchmarks.ik.query import Clock, ask, no_garbage_collection

#: Targets that a solver is asked one after the other before the next solver has its turn: so
#: whatever slows the machine for a while slows all of them.
BLOCK = 100
#: Calls before each block that don't count.
_WARM_UP = 10


@dataclass(frozen=True)
class AloneResult:
    """Times of single calls, interrupted or not.

    Attributes:
        median_us: the usual call [us].
        p99_us: 99 of 100 calls take at most so long [us].
        fastest_tenth_us: one call of ten is at least as quick [us]: on a machine that is shared,
            the nearest to an idle one.
    """

    median_us: float
    p99_us: float
    fastest_tenth_us: float

    @property
    def p99_over_median(self) -> float:
        """How much longer the slow calls take than the usual one."""
        return self.p99_us / self.median_us

    def as_plain_data(self) -> dict[str, Any]:
        """For JSON; the units are in the names."""
        return {**asdict(self), "p99_over_median": self.p99_over_median}


def measure_alone(
    solvers: Sequence[Peer],
    poses: FloatArray,
    dof: int,
    on_target: Callable[[int], None] = lambda done: None,
    clock: Clock = time.perf_counter_ns,
) -> dict[str, AloneResult]:
    """Ask each solver for many targets in a row, block by block.

    Args:
        solvers: whom to ask; their names differ.
        poses: ``(n, 7)``.
        dof: how many joints an answer has.
        on_target: told how many targets are done, of ``n``.
        clock: what times are taken by [ns].

    Returns:
        By the solvers' names.
    """
    times = np.empty((len(solvers), len(poses)))
    with no_garbage_collection():
        for begin in range(0, len(poses), BLOCK):
            block = poses[begin : begin + BLOCK]
            for number, solver in enumerate(solvers):
                for pose in block[:_WARM_UP]:
                    ask(solver, pose, dof)
                for row, pose in enumerate(block, start=begin):
                    times[number, row] = ask(solver, pose, dof, clock).nanoseconds
            on_target(begin + len(block))
    return {
        solver.name: AloneResult(*(1e-3 * np.percentile(of_solver, [50, 99, 10])).tolist())
        for solver, of_solver in zip(solvers, times, strict=True)
    }
