"""Independent jobs on all processors, by joblib; its other backends, as Ray's, can take them over.

Jobs on a Dask cluster: :mod:`benchmarks.jobs.dask_runner`.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import closing, contextmanager
from functools import lru_cache
from itertools import islice
from typing import Any, TypeVar

import joblib
from joblib.parallel import get_active_backend

from annik_core.errors import AnnikError
from annik_training.fitting.levenberg_marquardt import one_thread


class WorkerEnded(AnnikError):
    """A process that ran jobs ended in the midst of one."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(
            f"a worker process ended before its job was done, perhaps for lack of memory: run "
            f"again, with fewer --workers ({reason})"
        )


_Job = TypeVar("_Job")
_Outcome = TypeVar("_Outcome")

#: How often a worker looks whether its parent is still there [s].
_LOOK_EVERY = 1.0
#: Jobs for each worker at a time, where outcomes come only all together.
_BATCH = 4


def run_jobs(
    function: Callable[[_Job], _Outcome], jobs: Sequence[_Job], workers: int = -1
) -> Iterator[tuple[_Job, _Outcome]]:
    """Yield each job with its outcome as soon as it is done, in any order.

    The worker processes end when the iterator is closed, when an exception (Ctrl-C, too) leaves
    it, and when this process is killed.

    Args:
        function: what to do with a job; module level, so that it can be sent to a process.
        jobs: plain data.
        workers: processes, or -1 for as many as there are processors. Within a
            ``joblib.parallel_config(backend="ray")``, that backend decides.

    Raises:
        WorkerEnded: if a worker process was killed.
    """
    here = os.getpid()
    calls = (joblib.delayed(_with_job)(function, job, here) for job in jobs)
    try:
        with closing(_outcomes(calls, workers)) as outcomes:
            yield from outcomes
    except BrokenExecutor as error:
        raise WorkerEnded(str(error).partition("\n")[0]) from error


def _outcomes(calls: Iterator[Any], workers: int) -> Generator[Any, None, None]:
    backend, _ = get_active_backend()
    if backend.supports_return_generator:
        parallel = joblib.Parallel(n_jobs=workers, return_as="generator_unordered")
        with _interrupts_deferred():
            started = parallel(calls)
        with closing(started) as outcomes:
            yield from outcomes
        return
    # Ray's, for one, gives outcomes only when all calls are done.
    count = _BATCH * joblib.effective_n_jobs(workers)
    while batch := list(islice(calls, count)):
        yield from joblib.Parallel(n_jobs=workers)(batch)


@contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """Let Ctrl-C wait, and keep it from the processes that are started meanwhile.

    They inherit that, and end with this one. Otherwise a worker that is still loading would print
    a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _with_job(
    function: Callable[[_Job], _Outcome], job: _Job, runner: int
) -> tuple[_Job, _Outcome]:
    _end_with(runner)
    with one_thread():
        return job, function(job)


@lru_cache
def _end_with(runner: int) -> None:
    """End this worker when the process that runs the jobs is gone: joblib's would stay on."""
    if os.getppid() != runner:
        # The same process, or a worker of another backend, which looks after it.
        return

    def watch() -> None:
        while os.getppid() == runner:
            time.sleep(_LOOK_EVERY)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
