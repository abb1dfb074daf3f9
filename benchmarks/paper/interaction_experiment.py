"""What the paper's design can't see, and its repair: rank, and errors on an interaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from annik_training.designs.quadratic_model import quadratic_terms, vanishing_combinations
from annik_training.designs.registry import make_design
from benchmarks.jobs.fit_job import FitJob, FitOutcome, one_start
from benchmarks.study.training_options import TRAINING_OPTIONS
from benchmarks.systems.function_system import interaction

DESIGNS = ("thirty_phase", "thirty_phase_plus")
TRAININGS = ("plain", "linear_path", "sobolev")
STEPS = 3
#: Seeds for each seed of the other experiments: fits here are quick, and differ widely.
SEEDS_FACTOR = 4


def interaction_jobs(seeds: Sequence[int], max_evaluations: int) -> list[FitJob]:
    """Both designs at j = 3, on (q1 - q2)(q4 - q6) / 4."""
    return [
        FitJob(
            "interaction",
            design,
            STEPS,
            training,
            one_start(seed, max_evaluations=max_evaluations, **TRAINING_OPTIONS[training]),
            seed,
        )
        for design in DESIGNS
        for training in TRAININGS
        for seed in seeds
    ]


def median_errors(outcomes: Mapping[FitJob, FitOutcome]) -> dict[str, dict[str, float]]:
    """Median over the seeds of the rms error on unseen examples, by training and design."""
    return {
        training: {
            design: float(
                np.median(
                    [
                        outcome.error.rms
                        for job, outcome in outcomes.items()
                        if job.system == "interaction"
                        and (job.design, job.training) == (design, training)
                    ]
                )
            )
            for design in DESIGNS
        }
        for training in TRAININGS
    }


def nonzero_examples() -> dict[str, int]:
    """Number of examples at j = 3 at which the interaction is not zero, by design."""
    system = interaction()
    return {
        design: int(
            np.count_nonzero(np.abs(system.targets(make_design(system, design, STEPS, 0))) > 1e-9)
        )
        for design in DESIGNS
    }


def quadratic_rank(rows: Sequence[Sequence[int]]) -> int:
    """Number of terms of the quadratic model that are independent on integer rows ``(n, dof)``."""
    return len(quadratic_terms(len(rows[0]))) - int(vanishing_combinations(rows).shape[0])


def exact_ranks(steps: Sequence[int]) -> dict[str, dict[int, int]]:
    """Rank of the full quadratic model (28 terms) by design and j, in exact arithmetic."""
    system = interaction()
    ranks: dict[str, dict[int, int]] = {design: {} for design in DESIGNS}
    for design in DESIGNS:
        for j in steps:
            # The box is [-1, 1], so that half steps from the minimum are whole numbers.
            half_steps = np.rint((make_design(system, design, j, 0) + 1.0) * j).astype(int)
            ranks[design][j] = quadratic_rank(half_steps.tolist())
    return ranks
