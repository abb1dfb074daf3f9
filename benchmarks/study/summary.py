"""What a study found, over the seeds: medians and ranges."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO

import numpy as np

from benchmarks.jobs.fit_job import FitJob, FitOutcome
from benchmarks.systems.library import load_system

#: Errors below this, in the unit of the system, are none: less than any machine can tell.
NEGLIGIBLE = 1e-6


@dataclass(frozen=True)
class Spread:
    """Of a quantity over the seeds."""

    median: float
    least: float
    greatest: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Spread:
        """Median and range of one or more values."""
        return cls(float(np.median(values)), float(min(values)), float(max(values)))


@dataclass(frozen=True)
class SummaryRow:
    """A combination, over its seeds.

    Attributes:
        system: name of the system.
        design: name of the design.
        training: name of the training option.
        examples: how many the design has.
        seeds: how many were measured.
        unit: of the errors.
        rms_error: root of the mean square over the unseen examples.
        max_error: greatest of them.
        seconds: median, of the processor, for design and fit.
    """

    system: str
    design: str
    training: str
    examples: int
    seeds: int
    unit: str
    rms_error: Spread
    max_error: Spread
    seconds: float


def summarise(outcomes: Mapping[FitJob, FitOutcome]) -> list[SummaryRow]:
    """One row for each combination, in the order in which they first occur."""
    grouped: dict[tuple[str, str, str, int], list[FitOutcome]] = {}
    for job, outcome in outcomes.items():
        combination = (job.system, job.design, job.training, outcome.examples)
        grouped.setdefault(combination, []).append(outcome)
    return [
        SummaryRow(
            *combination,
            seeds=len(group),
            unit=load_system(combination[0]).error_unit,
            rms_error=Spread.of([outcome.error.rms for outcome in group]),
            max_error=Spread.of([outcome.error.max for outcome in group]),
            seconds=float(np.median([outcome.seconds for outcome in group])),
        )
        for combination, group in grouped.items()
    ]


def best_within(rows: Sequence[SummaryRow], examples: int) -> SummaryRow | None:
    """The row with the least median rms error of those with at most ``examples``, if any.

    Of errors that are negligible, the one with the fewest examples.
    """
    affordable = [row for row in rows if row.examples <= examples]
    return min(
        affordable,
        key=lambda row: (max(row.rms_error.median, NEGLIGIBLE), row.examples),
        default=None,
    )


def fewest_reaching(rows: Sequence[SummaryRow], error: float) -> SummaryRow:
    """The row of fewest examples among those whose median rms error is not above ``error``.

    Among equally many examples the one of least error.

    Args:
        rows: of which at least one is not above.
        error: in the unit of the rows.
    """
    return min(
        (row for row in rows if row.rms_error.median <= max(error, NEGLIGIBLE)),
        key=lambda row: (row.examples, max(row.rms_error.median, NEGLIGIBLE)),
    )


def error_text(error: float) -> str:
    """Two digits, for a reader."""
    if error < NEGLIGIBLE:
        return f"< {NEGLIGIBLE:.0e}"
    if error < 1e-4:
        return f"{error:.1e}"
    return np.format_float_positional(error, 2, unique=False, fractional=False, trim="-")


def as_csv(rows: Sequence[SummaryRow]) -> str:
    """All rows, with one line of names."""
    text = StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        (
            *("system", "design", "training", "examples", "seeds", "unit"),
            *("rms_error_median", "rms_error_min", "rms_error_max"),
            *("max_error_median", "max_error_min", "max_error_max"),
            "seconds_median",
        )
    )
    for row in rows:
        writer.writerow(
            (
                *(row.system, row.design, row.training, row.examples, row.seeds, row.unit),
                *(row.rms_error.median, row.rms_error.least, row.rms_error.greatest),
                *(row.max_error.median, row.max_error.least, row.max_error.greatest),
                row.seconds,
            )
        )
    return text.getvalue()
