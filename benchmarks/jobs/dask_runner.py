"""Independent jobs on a Dask cluster: of this machine, or any whose scheduler has an address."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import Any, TypeVar

from annik_core.errors import AnnikError, missing_dependency, one_line
from annik_core.installation import annik_version
from annik_training.fitting.levenberg_marquardt import one_thread

_Job = TypeVar("_Job")
_Outcome = TypeVar("_Outcome")

#: Longest wait for the scheduler, and then for its first worker [s].
TIMEOUT = 60.0


class ClusterFailed(AnnikError):
    """A Dask cluster can't be reached, has no worker, or can't go on."""

    def __init__(self, scheduler: str, reason: str) -> None:
        self.scheduler = scheduler
        self.reason = reason
        super().__init__(
            f"the Dask cluster at {scheduler} can't be used ({reason}): in checkouts of this "
            "version start `PYTHONPATH=. .venv/bin/dask scheduler` and `PYTHONPATH=. "
            ".venv/bin/dask worker ADDRESS --nthreads 1`, and run the same command to go on"
        )


class OtherVersion(AnnikError):
    """A worker has another version of annik than the program that gave it a job."""

    def __init__(self, worker: str, version: str, expected: str) -> None:
        self.worker = worker
        self.version = version
        self.expected = expected
        super().__init__(
            f"worker {worker} has annik {version}, not {expected}: install the same version there"
        )

    def __reduce__(self) -> tuple[type[OtherVersion], tuple[str, str, str]]:
        """As it comes from the worker."""
        return type(self), (self.worker, self.version, self.expected)


def run_jobs_on_dask(
    function: Callable[[_Job], _Outcome],
    jobs: Sequence[_Job],
    scheduler: str | None = None,
    workers: int = -1,
) -> Iterator[tuple[_Job, _Outcome]]:
    """Yield each job with its outcome as soon as it is done, in any order.

    Dask gives the jobs of a worker that ends to the others. A cluster of this machine ends with
    the iterator; of another one, the jobs that are not done are withdrawn.

    Args:
        function: what to do with a job; module level, in a module that the workers have too.
        jobs: plain data.
        scheduler: its address, as tcp://HOST:8786; None for a cluster on this machine.
        workers: processes of that cluster, or -1 for as many as there are processors.

    Raises:
        ClusterFailed: if the scheduler or its workers are not there, or one job ended several
            workers.
        MissingDependency: if Dask is not installed.
        OtherVersion: if a worker has another version of annik.
    """
    try:
        from distributed import Client, LocalCluster, as_completed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise missing_dependency(error, "--backend dask") from error
    place = scheduler or "this machine"
    with ExitStack() as stack:
        try:
            cluster: Any = scheduler
            if scheduler is None:
                cluster = stack.enter_context(
                    LocalCluster(
                        n_workers=os.cpu_count() if workers < 0 else workers,
                        threads_per_worker=1,
                        dashboard_address=None,
                        silence_logs=logging.ERROR,
                    )
                )
            client = stack.enter_context(Client(cluster, timeout=TIMEOUT, set_as_default=False))
            client.wait_for_workers(1, timeout=TIMEOUT)
            futures = {
                client.submit(_outcome, function, job, annik_version(), pure=False): job
                for job in jobs
            }
            for future in as_completed(futures, loop=client.loop):
                yield futures.pop(future), future.result()
                future.release()
        # OSError has Dask's own of the connection, and those of time.
        except (KilledWorker, OSError, TimeoutError, ModuleNotFoundError) as error:
            raise ClusterFailed(place, one_line(error)) from error
        except RuntimeError as error:
            # So a scheduler says that it can't import what the jobs are made of.
            if "deserialization" not in str(error):
                raise
            raise ClusterFailed(place, "its scheduler can't import annik") from error


def _outcome(function: Callable[[_Job], _Outcome], job: _Job, version: str) -> _Outcome:
    """Run a job in a worker, as it is run in the processes of joblib."""
    if annik_version() != version:
        from distributed import get_worker

        raise OtherVersion(get_worker().address, annik_version(), version)
    with one_thread():
        return function(job)
