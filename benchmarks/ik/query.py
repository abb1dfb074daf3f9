"""One timed call of one solver; no fault of a solver ends the run."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Peer

#: Gives the time [ns], from any origin.
Clock = Callable[[], int]


class TimedSolution(NamedTuple):
    """The outcome of one call.

    Attributes:
        joint_positions: ``(dof,)`` finite, or None: reported failure, unusable, or an exception.
        nanoseconds: duration of the call.
        fault: the exception, or what was wrong with the returned value; empty if it only failed.
    """

    joint_positions: FloatArray | None
    nanoseconds: int
    fault: str


def timed_solve(
    solver: Peer,
    pose: FloatArray,
    dof: int,
    clock: Clock = time.perf_counter_ns,
    start: FloatArray | None = None,
) -> TimedSolution:
    """Let a solver solve one pose ``(7,)`` for ``dof`` joints; only its own call is timed.

    From a start ``(dof,)``, or, without, from its own.
    """
    # A solver may write to its arguments.
    own = [pose.copy(), *([] if start is None else [start.copy()])]
    fault = ""
    returned: object = None
    begin = clock()
    try:
        returned = solver.solve(*own)
    except (KeyboardInterrupt, SystemExit):
        raise
    # A panic of a Rust library is a BaseException.
    except BaseException as error:
        fault = f"{type(error).__name__}: {error}".partition("\n")[0]
    nanoseconds = clock() - begin
    if returned is None:
        return TimedSolution(None, nanoseconds, fault)
    # A solver may reuse the memory.
    positions = np.array(returned, dtype=np.float64)
    if positions.shape != (dof,) or not np.isfinite(positions).all():
        return TimedSolution(
            None, nanoseconds, f"not {dof} finite numbers: {returned}".partition("\n")[0]
        )
    return TimedSolution(positions, nanoseconds, "")


def collect_garbage() -> None:
    """Collect the young generations, which hold the garbage of the calls so far."""
    gc.collect(1)


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Keep Python's garbage collection out of the timed calls."""
    was_on = gc.isenabled()
    collect_garbage()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def balanced_order(count: int, turn: int) -> list[int]:
    """The order of the solvers in a turn, by a Williams design.

    Over ``2 * count`` turns each solver has each place equally often and follows each other one
    equally often: after a slow one the caches are cold.
    """
    row, reverse = turn % count, (turn // count) % 2
    zigzag = [(place + 1) // 2 if place % 2 else -(place // 2) for place in range(count)]
    order = [(step + row) % count for step in zigzag]
    return order[::-1] if reverse else order
