"""Section 2: F = (f1, ..., f6) by 4-fold cross-validation, tested on a diagonal: Table 4."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_training.fitting.fit import examples_of
from annik_training.fitting.options import FitOptions
from benchmarks.paper.cross_validation import cross_validate
from benchmarks.paper.example_sets import function_set
from benchmarks.systems.function_system import paper_functions

FOLDS = 4


@dataclass(frozen=True)
class CrossValidationJob:
    """One cross-validation.

    Attributes:
        method: which set of examples.
        options: how to fit; the seed deals the folds and draws the starts.
    """

    method: str
    options: FitOptions


@dataclass(frozen=True, eq=False)
class FoldOutcome:
    """One network of a cross-validation.

    Attributes:
        training_error: mean square error on the other folds, scaled.
        test_errors: ``(90, 6)`` network minus F on the diagonal, in the units of F.
    """

    training_error: float
    test_errors: FloatArray

    @property
    def mean_square_error(self) -> float:
        """Over the diagonal and the six outputs: what Table 4 has."""
        return float(np.mean(self.test_errors**2))


def test_diagonal() -> FloatArray:
    """The 90 points of Table 3: all joints at 0.5, 1.5, ..., 89.5 degrees. ``(90, 6)`` [rad]."""
    return np.tile(np.radians(np.arange(0.5, 90.0))[:, np.newaxis], 6)


def run_cross_validation(job: CrossValidationJob) -> tuple[FoldOutcome, ...]:
    """Fit the four networks and test each."""
    system = paper_functions()
    examples = examples_of(system, function_set(job.method), job.options)
    diagonal = test_diagonal()
    truth = system.targets(diagonal)
    return tuple(
        FoldOutcome(fold.training_error, fold.network.predict(diagonal) - truth)
        for fold in cross_validate(examples, FOLDS, job.options)
    )
