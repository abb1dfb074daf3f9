"""All experiments of the paper from one master seed: independent jobs, then results.json."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from annik_training.fitting.options import FitOptions
from benchmarks.jobs.fit_job import FitJob, FitOutcome, run_fit_job
from benchmarks.jobs.job_runner import run_jobs
from benchmarks.paper import paper_values as printed
from benchmarks.paper.efficiency_experiment import LADDERS, efficiency_jobs
from benchmarks.paper.function_experiment import (
    CrossValidationJob,
    FoldOutcome,
    run_cross_validation,
)
from benchmarks.paper.interaction_experiment import SEEDS_FACTOR, interaction_jobs
from benchmarks.paper.robot_experiment import RobotSetJob, RobotSetOutcome, run_robot_set

Job = CrossValidationJob | RobotSetJob | FitJob
#: Called with the number of finished jobs and of all.
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class PaperSettings:
    """How thoroughly to reproduce.

    Attributes:
        seed: the master seed; every other one is drawn from it.
        seeds: how many random starts (and deals of the folds, and draws of a design).
        max_evaluations: of the residual, per fit.
        ladders: which numbers of examples to try in the search for the fewest.
    """

    seed: int = 2026
    seeds: int = 10
    max_evaluations: int = 50
    ladders: Mapping[tuple[str, str], tuple[int, ...]] = field(default_factory=lambda: LADDERS)

    @classmethod
    def quick(cls, seed: int) -> PaperSettings:
        """Every part in about a minute: what it finds is rough."""
        ladders = {
            ("gantry", "plain"): (54,),
            ("gantry", "linear_path"): (7,),
            ("gantry", "sobolev"): (14,),
            ("F", "plain"): (75,),
            ("F", "linear_path"): (75,),
            ("F", "sobolev"): (14,),
        }
        return cls(seed=seed, seeds=2, max_evaluations=15, ladders=ladders)

    def drawn_seeds(self, times: int = 1) -> list[int]:
        """The seeds of the repetitions, or ``times`` as many."""
        numbers = np.random.SeedSequence(self.seed).generate_state(times * self.seeds)
        return [int(number) for number in numbers]


@dataclass(frozen=True, eq=False)
class Measurements:
    """Everything that was measured.

    Attributes:
        settings: how.
        functions: Table 4: the folds of every cross-validation, by method.
        robot: Tables 9 and 10, by method and set.
        fits: the single fits of the other experiments.
        seconds: for all of it.
    """

    settings: PaperSettings
    functions: Mapping[str, tuple[FoldOutcome, ...]]
    robot: Mapping[tuple[str, str], RobotSetOutcome]
    fits: Mapping[FitJob, FitOutcome]
    seconds: float


def measure(
    settings: PaperSettings, workers: int = -1, on_progress: Progress | None = None
) -> Measurements:
    """Run all experiments.

    Args:
        settings: how thoroughly.
        workers: processes; see :func:`benchmarks.jobs.job_runner.run_jobs`.
        on_progress: see :data:`Progress`.
    """
    begin = time.perf_counter()
    jobs = paper_jobs(settings)
    outcomes: dict[Job, Any] = {}
    for job, outcome in run_jobs(_run, jobs, workers):
        outcomes[job] = outcome
        if on_progress is not None:
            on_progress(len(outcomes), len(jobs))
    # In the order of the jobs, not in that of their ends.
    done = [(job, outcomes[job]) for job in jobs]
    return Measurements(
        settings,
        {
            method: tuple(
                fold
                for job, folds in done
                if isinstance(job, CrossValidationJob) and job.method == method
                for fold in folds
            )
            for method in printed.METHODS
        },
        {(job.method, job.name): outcome for job, outcome in done if isinstance(job, RobotSetJob)},
        {job: outcome for job, outcome in done if isinstance(job, FitJob)},
        time.perf_counter() - begin,
    )


def paper_jobs(settings: PaperSettings) -> list[Job]:
    """The jobs of all experiments, the longest first."""
    seeds = settings.drawn_seeds()
    robot_options = FitOptions(
        restarts=settings.seeds, max_evaluations=settings.max_evaluations, seed=settings.seed
    )
    return [
        *(
            RobotSetJob(method, name, robot_options)
            for name in reversed(printed.SETS)
            for method in printed.METHODS
        ),
        *(
            CrossValidationJob(
                method, FitOptions(max_evaluations=settings.max_evaluations, seed=seed)
            )
            for seed in seeds
            for method in printed.METHODS
        ),
        *efficiency_jobs(seeds, settings.max_evaluations, settings.ladders),
        *interaction_jobs(settings.drawn_seeds(SEEDS_FACTOR), settings.max_evaluations),
    ]


def _run(job: Job) -> Any:
    if isinstance(job, CrossValidationJob):
        return run_cross_validation(job)
    if isinstance(job, RobotSetJob):
        return run_robot_set(job)
    return run_fit_job(job)
