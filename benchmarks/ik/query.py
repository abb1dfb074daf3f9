"""One question to one solver, timed; whatever it does, it ends no run."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Peer

#: Nanoseconds from anywhere.
Clock = Callable[[], int]


class Asked(NamedTuple):
    """What came of one question.

    Attributes:
        joint_positions: ``(dof,)`` finite, or None: reported failure, nonsense, or an exception.
        nanoseconds: how long the solver took.
        fault: what it raised or what was wrong with the answer; empty if it only failed.
    """

    joint_positions: FloatArray | None
    nanoseconds: int
    fault: str


def ask(solver: Peer, pose: FloatArray, dof: int, clock: Clock = time.perf_counter_ns) -> Asked:
    """Let a solver solve one pose ``(7,)`` for ``dof`` joints; only its own call is timed."""
    # Its own copy: nobody else is to see what a solver does with it.
    own = pose.copy()
    fault = ""
    answer: object = None
    begin = clock()
    try:
        answer = solver.solve(own)
    except (KeyboardInterrupt, SystemExit):
        raise
    # Panics of libraries in Rust are no Exception.
    except BaseException as error:
        fault = f"{type(error).__name__}: {error}".partition("\n")[0]
    nanoseconds = clock() - begin
    if answer is None:
        return Asked(None, nanoseconds, fault)
    # A copy, because a solver may use the same memory for its next answer.
    positions = np.array(answer, dtype=np.float64)
    if positions.shape != (dof,) or not np.isfinite(positions).all():
        return Asked(None, nanoseconds, f"not {dof} finite numbers: {answer}".partition("\n")[0])
    return Asked(positions, nanoseconds, "")


def tidy_up() -> None:
    """Collect the garbage of the calls so far, which is young; older objects are left alone."""
    gc.collect(1)


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Keep Python from tidying up in the midst of a call; it does so before."""
    was_on = gc.isenabled()
    tidy_up()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def balanced_order(count: int, turn: int) -> list[int]:
    """The order in which solvers are asked, another one each turn.

    Over ``2 * count`` turns each solver is asked as often at each place, and as often right after
    each other one (a Williams design): after a slow one the caches are cold. A plain rotation
    would keep each behind the same one.
    """
    row, reverse = turn % count, (turn // count) % 2
    zigzag = [(place + 1) // 2 if place % 2 else -(place // 2) for place in range(count)]
    order = [(step + row) % count for step in zigzag]
    return order[::-1] if reverse else order
