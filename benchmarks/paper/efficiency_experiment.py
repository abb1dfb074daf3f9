"""How few examples are enough: the smallest designs by which a fit reaches an accuracy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.jobs.fit_job import FitJob, FitOutcome, one_start
from benchmarks.study.training_options import TRAINING_OPTIONS

DESIGNS = ("sobol", "latin_hypercube")
#: The ways to fit that are compared, as the page and its figures call them.
TRAINING_TITLES: Mapping[str, str] = {
    "plain": "plain",
    "linear_path": "linear path",
    "sobolev": "Sobolev",
}


@dataclass(frozen=True)
class Accuracy:
    """An accuracy that the median over the seeds is to reach.

    Attributes:
        name: in the results.
        system: of which system.
        measure: ``max``: greatest error of the unseen examples; ``mse``: mean square error.
        bound: in the unit of the system.
        meaning: in words.
    """

    name: str
    system: str
    measure: str
    bound: float
    meaning: str

    def reached(self, outcomes: Iterable[FitOutcome]) -> bool:
        """Whether the median over outcomes that differ in the seed is within the bound."""
        return float(np.median([self.measured(outcome) for outcome in outcomes])) <= self.bound

    def measured(self, outcome: FitOutcome) -> float:
        """The measure of one outcome."""
        return outcome.mean_square_error if self.measure == "mse" else outcome.error.max


ACCURACIES = (
    Accuracy(
        "position_0_25mm", "gantry", "max", 0.25, "the robot within 0.25 mm in the whole workspace"
    ),
    Accuracy(
        "position_0_01mm", "gantry", "max", 0.01, "the robot within 0.01 mm in the whole workspace"
    ),
    Accuracy("mse_2e-4", "F", "mse", 2e-4, "F to a mean square error of 2e-4"),
)

#: Numbers of examples to try by system and way to fit: from too few to more than enough.
LADDERS: Mapping[tuple[str, str], tuple[int, ...]] = {
    ("gantry", "plain"): (24, 28, 33, 39, 46, 54, 64, 75),
    ("gantry", "linear_path"): (5, 6, 7, 8, 10, 14),
    ("gantry", "sobolev"): (5, 6, 7, 8, 10, 12, 14, 17, 20),
    ("F", "plain"): (39, 46, 54, 64, 75, 88),
    ("F", "linear_path"): (39, 46, 54, 64, 75, 88),
    ("F", "sobolev"): (6, 7, 8, 9, 10, 12, 14, 17),
}


@dataclass(frozen=True)
class Fewest:
    """The smallest design that was found to be enough.

    Attributes:
        accuracy: to be reached.
        design: name of the design.
        training: name of the way to fit.
        examples: how many, or None if the longest ladder was too short.
    """

    accuracy: Accuracy
    design: str
    training: str
    examples: int | None


def efficiency_jobs(
    seeds: Sequence[int], max_evaluations: int, ladders: Mapping[tuple[str, str], Sequence[int]]
) -> list[FitJob]:
    """Every design, way to fit, number of examples and seed."""
    return [
        FitJob(
            system,
            design,
            examples,
            training,
            one_start(seed, max_evaluations=max_evaluations, **TRAINING_OPTIONS[training]),
            seed,
        )
        for (system, training), ladder in ladders.items()
        for design in DESIGNS
        for examples in ladder
        for seed in seeds
    ]


def fewest_examples(outcomes: Mapping[FitJob, FitOutcome]) -> list[Fewest]:
    """For each accuracy, design and way to fit, the least number of examples that reaches it.

    It is reached with this number and with every larger one that was tried.
    """
    grouped: dict[tuple[str, str, str], dict[int, list[FitOutcome]]] = {}
    for job, outcome in outcomes.items():
        ladder = grouped.setdefault((job.system, job.design, job.training), {})
        ladder.setdefault(job.size, []).append(outcome)
    found = []
    for accuracy in ACCURACIES:
        for (system, design, training), ladder in sorted(grouped.items()):
            if system != accuracy.system:
                continue
            enough: int | None = None
            for examples in sorted(ladder, reverse=True):
                if not accuracy.reached(ladder[examples]):
                    break
                enough = examples
            found.append(Fewest(accuracy, design, training, enough))
    return found


def least(found: Sequence[Fewest], accuracy: Accuracy) -> Fewest | None:
    """The smallest of those for an accuracy, if any was found."""
    enough = [
        (few.examples, few)
        for few in found
        if few.accuracy == accuracy and few.examples is not None
    ]
    return min(enough, key=lambda pair: pair[0])[1] if enough else None
