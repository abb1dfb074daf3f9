"""One measurement of many: a design, one start of a fit to it, and the errors on unseen examples.

A job is plain data and so is its outcome: jobs may run in other processes or on other machines, in
any order, and give the same there.
"""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from annik_training.designs.registry import make_design
from annik_training.evaluation import ErrorSummary
from annik_training.fitting.fit import best_of, examples_of, fit_restarts
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import System
from benchmarks.systems.library import load_system

TEST_EXAMPLES = 2000
_TEST_SEED = 20_000


@dataclass(frozen=True)
class FitJob:
    """What to measure.

    Attributes:
        system: name of the system.
        design: name of the design of experiments.
        size: its size.
        training: name of the training option, for the reader of the outcome.
        options: how to fit; every example is fitted, from one start.
        seed: of the design and of the start.
    """

    system: str
    design: str
    size: int
    training: str
    options: FitOptions
    seed: int

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return {**asdict(self), "options": self.options.to_dict()}


@dataclass(frozen=True)
class FitOutcome:
    """What was measured.

    Attributes:
        examples: size of the design in examples.
        training_error: mean square error of the fit, scaled.
        error: of 2,000 random examples of the joint box, in the unit of the system.
        seconds: for design and fit.
    """

    examples: int
    training_error: float
    error: ErrorSummary
    seconds: float

    @property
    def mean_square_error(self) -> float:
        """Of the unseen examples; for a function also over its outputs."""
        return self.error.rms**2


def run_fit_job(job: FitJob) -> FitOutcome:
    """Make the design, fit and measure."""
    system = load_system(job.system)
    begin = time.perf_counter()
    joint_positions = make_design(system, job.design, job.size, job.seed)
    restarts = fit_restarts(examples_of(system, joint_positions, job.options), job.options)
    seconds = time.perf_counter() - begin
    unseen, inputs = unseen_examples(job.system)
    errors = system.errors(unseen, best_of(restarts).network.predict(inputs))
    return FitOutcome(
        len(joint_positions),
        restarts[0].training_error,
        ErrorSummary.of(errors),
        seconds,
    )


def one_start(seed: int, **options: Any) -> FitOptions:
    """Options of a fit from one start to all examples."""
    return FitOptions(restarts=1, held_out_fraction=0.0, seed=seed, **options)


@lru_cache
def unseen_examples(system: str) -> tuple[FloatArray, FloatArray]:
    """Joint positions ``(2000, dof)`` drawn from the joint box, and their inputs; always these."""
    known = load_system(system)
    joint_positions = random_joint_positions(known, TEST_EXAMPLES, _TEST_SEED)
    return joint_positions, known.inputs(joint_positions)


def random_joint_positions(system: System, count: int, seed: int) -> FloatArray:
    """Independent and uniform in the joint box ``(count, dof)``."""
    return system.joint_box.sample(count, np.random.default_rng(seed))
