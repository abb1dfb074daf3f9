"""Example efficiency: how the error falls with the number of examples, for every combination.

Independent jobs, each safe on the disk as soon as it is done: a study that was stopped in any way
goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.jobs.fit_job import FitJob, FitOutcome
from benchmarks.jobs.job_runner import run_jobs
from benchmarks.study.grid import study_grid
from benchmarks.study.job import JobFailure, try_fit_job
from benchmarks.study.results import StudyResults
from benchmarks.study.settings import StudySettings


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        jobs: how many there are.
        done: how many have an outcome.
        failed: how many failed in this run.
        done_before: of those done, how many were when this run began.
        truncated: whether an incomplete last line was removed from the file of results.
    """

    jobs: int
    done: int
    failed: int
    done_before: int
    truncated: bool


@dataclass(frozen=True)
class StudyOutcome:
    """What a study found.

    Attributes:
        settings: what was compared.
        outcomes: of the jobs that are done, in the order of the jobs.
        failures: reasons of the others.
        left_out: combinations that make no sense, each as a line.
    """

    settings: StudySettings
    outcomes: Mapping[FitJob, FitOutcome]
    failures: Mapping[FitJob, str]
    left_out: tuple[str, ...]


#: Runs jobs and yields each with its outcome.
Runner = Callable[
    [Callable[[FitJob], FitOutcome | JobFailure], Sequence[FitJob]],
    Iterator[tuple[FitJob, FitOutcome | JobFailure]],
]


def run_study(
    settings: StudySettings,
    folder: Path,
    runner: Runner = run_jobs,
    on_progress: Callable[[StudyProgress], None] | None = None,
) -> StudyOutcome:
    """Run the jobs that are not done yet.

    Args:
        settings: what to compare.
        folder: where the results are kept.
        runner: where the jobs are run: :func:`benchmarks.jobs.job_runner.run_jobs`, or
            :func:`benchmarks.jobs.dask_runner.run_jobs_on_dask`.
        on_progress: called at the beginning, and after each job.

    Raises:
        InvalidValue: if there is no such system.
        NotWritable, InUse, DamagedRecord: if the results in the folder can't be used.
        RobotError: if a robot can't be used.
        WorkerEnded, ClusterFailed: if the processes of the runner end.
    """
    grid = study_grid(settings)
    with StudyResults(folder) as results:
        found = {job: results.outcome(job) for job in grid.jobs}
        # What failed is tried again: the fault may have been the machine's.
        to_do = [job for job, outcome in found.items() if not isinstance(outcome, FitOutcome)]
        done_before = len(grid.jobs) - len(to_do)
        done, failed = done_before, 0

        def tell() -> None:
            if on_progress is not None:
                on_progress(
                    StudyProgress(len(grid.jobs), done, failed, done_before, results.truncated)
                )

        tell()
        try:
            for job, outcome in runner(try_fit_job, to_do):
                results.record(job, outcome)
                found[job] = outcome
                if isinstance(outcome, JobFailure):
                    failed += 1
                else:
                    done += 1
                tell()
        except KeyboardInterrupt:
            # It may have come after an outcome was written and before it was counted.
            results.read_again()
            done = sum(isinstance(results.outcome(job), FitOutcome) for job in grid.jobs)
            tell()
            raise
    return StudyOutcome(
        settings,
        {job: outcome for job, outcome in found.items() if isinstance(outcome, FitOutcome)},
        {job: outcome.reason for job, outcome in found.items() if isinstance(outcome, JobFailure)},
        grid.left_out,
    )
