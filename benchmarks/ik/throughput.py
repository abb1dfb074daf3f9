"""Poses per second, in batches.

annik takes a batch in one call of ``solve_batch``. The Python packages of the others have no such
call: they solve one pose after another in a loop.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from annik_core.model.artifact import Model
from annik_core.pose import FloatArray
from annik_core.solver.ik_solver import IkSolver, usable_cores
from annik_core.solver.mode import SolverMode
from benchmarks.ik.annik import BatchSolver
from benchmarks.ik.peers.peer import Peer
from benchmarks.ik.query import no_garbage_collection

#: Poses in a batch.
SIZES = (1, 64, 4096)
#: Rounds over all solvers; the median counts.
_ROUNDS = 3
_THREAD_ROUNDS = 15
#: Duration of a turn [s]: batches are repeated, a loop may end within one.
SECONDS = 0.2


def measure_throughput(
    solvers: Sequence[Peer],
    poses: FloatArray,
    sizes: Sequence[int],
    seconds: float,
    on_turn: Callable[[int], None] = lambda done: None,
) -> dict[str, dict[int, float]]:
    """Poses per second of each solver for each size of batch.

    Args:
        solvers: with different names.
        poses: ``(n, 7)``, n not below the largest size.
        sizes: of the batches.
        seconds: how long a turn takes; longer only where one batch in one call does.
        on_turn: called with the number of finished turns, of :func:`turns`.

    Returns:
        By the solvers' names, then by the size.
    """
    rates: dict[str, dict[int, list[float]]] = {
        solver.name: {size: [] for size in sizes} for solver in solvers
    }
    done = 0
    for _ in range(_ROUNDS):
        for size in sizes:
            for solver in solvers:
                with no_garbage_collection():
                    rates[solver.name][size].append(_rate(solver, poses, size, seconds))
                done += 1
                on_turn(done)
    return {
        name: {size: float(np.median(values)) for size, values in of_solver.items()}
        for name, of_solver in rates.items()
    }


def measure_threads(model: Model, poses: FloatArray) -> dict[int, float]:
    """Poses per second that annik solves in one call, refined, by the number of threads.

    From one to as many as there are processor cores for this process; the median of some rounds.
    """
    solver, rates = IkSolver(model, mode=SolverMode.REFINED), dict[int, list[float]]()
    for _ in range(_THREAD_ROUNDS):
        for threads in range(1, usable_cores() + 1):
            with no_garbage_collection():
                begin = time.perf_counter()
                solver.solve_batch(poses, threads)
                rate = len(poses) / (time.perf_counter() - begin)
                rates.setdefault(threads, []).append(rate)
    return {threads: float(np.median(found)) for threads, found in rates.items()}


def turns(solvers: int, sizes: int) -> int:
    """How many turns :func:`measure_throughput` takes."""
    return _ROUNDS * sizes * solvers


def _rate(solver: Peer, poses: FloatArray, size: int, seconds: float) -> float:
    """Poses per second in one turn; each repetition takes the next poses."""
    offset = solved = 0
    begin = now = time.perf_counter()
    while now - begin < seconds:
        batch = poses[offset : offset + size]
        offset = offset + size if offset + 2 * size <= len(poses) else 0
        if isinstance(solver, BatchSolver):
            solver.solve_batch(batch)
            solved += len(batch)
            now = time.perf_counter()
            continue
        for pose in batch:
            _solve(solver, pose)
            solved += 1
            now = time.perf_counter()
            if now - begin >= seconds:
                break
    return solved / (now - begin)


def _solve(solver: Peer, pose: FloatArray) -> None:
    try:
        solver.solve(pose)
    except (KeyboardInterrupt, SystemExit):
        raise
    # Faults are counted on the targets; a panic of a Rust library is a BaseException.
    except BaseException:
        pass
