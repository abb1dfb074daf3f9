"""The jobs of a study: every possible combination, at the sizes that the designs can have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from annik_core.errors import InvalidValue
from annik_core.robots.errors import UnknownRobot
from annik_training.designs.registry import DESIGNS, check_subject, make_design
from annik_training.errors import UnsupportedRobot
from annik_training.fitting.problem import System
from benchmarks.jobs.fit_job import FitJob, one_start
from benchmarks.study.settings import StudySettings
from benchmarks.study.training_options import TRAINING_OPTIONS
from benchmarks.systems.library import ANALYTIC_SYSTEMS, load_system


@dataclass(frozen=True)
class StudyGrid:
    """What a study is to measure.

    Attributes:
        jobs: all of them, one repetition after the other, so that a study which was stopped has
            measured every combination equally often, or nearly.
        left_out: combinations that are impossible or twice the same, each as a line.
    """

    jobs: tuple[FitJob, ...]
    left_out: tuple[str, ...]


def study_grid(settings: StudySettings) -> StudyGrid:
    """Every system, design, size, training option and seed.

    A design is left out for a system that it can't be made for, or for which its examples are
    those of a design before it.

    Raises:
        InvalidValue: if there is no such system.
        RobotError: if the definition of a robot can't be used.
    """
    chosen: list[tuple[str, str, int]] = []
    left_out: list[str] = []
    for name in settings.systems:
        system = _system(name)
        known: dict[bytes, str] = {}
        for design in settings.designs:
            try:
                sizes = nearest_sizes(design, system, settings.examples)
            except UnsupportedRobot as error:
                left_out.append(f"{design} for {name}: {error.reason}")
                continue
            if not _is_sized_in_examples(design):
                fingerprint = _fingerprint(design, system, sizes)
                if fingerprint in known:
                    left_out.append(f"{design} for {name}: the examples of {known[fingerprint]}")
                    continue
                known[fingerprint] = design
            chosen += [(name, design, size) for size in sizes]
    jobs = tuple(
        FitJob(
            name,
            design,
            size,
            training,
            one_start(
                seed, max_evaluations=settings.max_evaluations, **TRAINING_OPTIONS[training]
            ),
            seed,
        )
        for seed in range(settings.seeds)
        for name, design, size in chosen
        for training in settings.training
    )
    return StudyGrid(jobs, tuple(left_out))


def nearest_sizes(design: str, system: System, examples: Sequence[int]) -> list[int]:
    """Sizes of a design, ascending, for which it has about the wanted numbers of examples.

    Nearest by the ratio, since the axis is logarithmic. Where two of the numbers have the same
    nearest size, it is there once.

    Args:
        design: name of the design.
        system: what the examples are for.
        examples: the wanted numbers.

    Raises:
        UnsupportedRobot: if the design can't be made for the system.
    """
    check_subject(design, system)
    if _is_sized_in_examples(design):
        return sorted(examples)
    counts = _counts(design, system, max(examples))
    return sorted(
        {
            min(counts, key=lambda size: (abs(math.log(counts[size] / wanted)), size))
            for wanted in examples
        }
    )


def _system(name: str) -> System:
    try:
        return load_system(name)
    except UnknownRobot as error:
        allowed = (
            f"{', '.join(ANALYTIC_SYSTEMS)}, a packaged robot ({', '.join(error.known)}) or the "
            "path of a robot definition (.yaml)"
        )
        raise InvalidValue("systems", name, allowed) from error


def _is_sized_in_examples(design: str) -> bool:
    return DESIGNS[design].size.name == "examples"


def _counts(design: str, system: System, most: int) -> dict[int, int]:
    """Examples of every size, up to the first with more than wanted."""
    counts: dict[int, int] = {}
    allowed = DESIGNS[design].size
    for size in range(allowed.minimum, allowed.maximum + 1):
        counts[size] = len(make_design(system, design, size, 0))
        if counts[size] > most:
            break
    return counts


def _fingerprint(design: str, system: System, sizes: Sequence[int]) -> bytes:
    """The examples of a design in which nothing is random."""
    return b"".join(
        np.ascontiguousarray(make_design(system, design, size, 0)).tobytes() for size in sizes
    )
