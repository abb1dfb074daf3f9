"""What a study compares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from annik_core.errors import InvalidValue
from annik_training.designs.registry import DESIGNS, find_design
from annik_training.fitting.options import FitOptions
from benchmarks.study.training_options import TRAINING_OPTIONS

_EXAMPLES = (2, 10_000)
_SEEDS = (1, 1000)


@dataclass(frozen=True)
class StudySettings:
    """What a study compares: every combination of these.

    Attributes:
        systems: names for :func:`benchmarks.systems.library.load_system`.
        designs: keys of :data:`annik_training.designs.registry.DESIGNS`.
        training: keys of :data:`benchmarks.study.training_options.TRAINING_OPTIONS`.
        examples: how many examples; a design that can't have as many has the nearest number.
        seeds: how often each is repeated, with other random starts and other random designs.
        max_evaluations: of the residual, per fit.

    Raises:
        InvalidValue: naming the setting and what is allowed.
    """

    systems: tuple[str, ...] = ("gantry", "F", "elbow_arm")
    designs: tuple[str, ...] = field(default_factory=lambda: tuple(DESIGNS))
    training: tuple[str, ...] = tuple(TRAINING_OPTIONS)
    examples: tuple[int, ...] = (16, 32, 64, 128)
    seeds: int = 5
    max_evaluations: int = FitOptions.max_evaluations

    def __post_init__(self) -> None:
        """Check every setting."""
        for setting in ("systems", "designs", "training", "examples"):
            values = getattr(self, setting)
            if not values or len(set(values)) < len(values):
                raise InvalidValue(setting, values, "one or more, each once")
        for design in self.designs:
            find_design(design)
        for training in self.training:
            if training not in TRAINING_OPTIONS:
                raise InvalidValue("training", training, _one_of(tuple(TRAINING_OPTIONS)))
        for examples in self.examples:
            _check("examples", examples, _EXAMPLES)
        _check("seeds", self.seeds, _SEEDS)
        # Refuses a number of evaluations out of range.
        FitOptions(max_evaluations=self.max_evaluations)

    @classmethod
    def quick(cls) -> StudySettings:
        """Every part in about a minute: what it finds is rough."""
        return cls(
            designs=("thirty_phase", "central_composite", "latin_hypercube", "sobol"),
            training=("plain", "linear_path", "sobolev"),
            examples=(16, 64),
            seeds=2,
            max_evaluations=15,
        )


def _check(setting: str, value: int, allowed: tuple[int, int]) -> None:
    if not allowed[0] <= value <= allowed[1]:
        raise InvalidValue(setting, value, f"{allowed[0]} to {allowed[1]}")


def _one_of(names: Sequence[str]) -> str:
    return f"one or more of {', '.join(names)}"
