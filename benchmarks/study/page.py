"""The page about a study, in Markdown: figures, and tables of what was best."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields

from benchmarks.conditions import machine
from benchmarks.jobs.fit_job import TEST_EXAMPLES
from benchmarks.markdown import markdown_table
from benchmarks.study.run import StudyOutcome
from benchmarks.study.settings import StudySettings
from benchmarks.study.summary import (
    NEGLIGIBLE,
    Spread,
    SummaryRow,
    best_within,
    error_text,
    fewest_reaching,
)
from benchmarks.study.training_options import TRAINING_MEANINGS

#: Where the figures are, beside the page.
IMAGES = "images"
_MOST_FAILURES = 10


def figure_name(system: str) -> str:
    """File of a system's figure; a robot's may be a path."""
    return f"study_{re.sub(r'[^A-Za-z0-9_-]+', '-', system).strip('-')}.png"


def study_page(outcome: StudyOutcome, rows: Sequence[SummaryRow], *, in_docs: bool = False) -> str:
    """The page.

    Args:
        outcome: what was found.
        rows: its summary.
        in_docs: whether it will be beside the other documentation.
    """
    settings = outcome.settings
    parts = [
        "# How many examples",
        f"<!-- Written by `{command(settings)}`. -->",
        _introduction(settings, in_docs),
        *(
            _system_part([row for row in rows if row.system == system], settings)
            for system in dict.fromkeys(row.system for row in rows)
        ),
        _how_measured(outcome),
        _not_measured(outcome),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def command(settings: StudySettings) -> str:
    """What to type for these settings."""
    standard = StudySettings()
    options = [
        f"--{entry.name.replace('_', '-')} {_typed(getattr(settings, entry.name))}"
        for entry in fields(settings)
        if getattr(settings, entry.name) != getattr(standard, entry.name)
    ]
    return " ".join(["./run study", *options])


def _typed(value: tuple[object, ...] | int) -> str:
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _introduction(settings: StudySettings, in_docs: bool) -> str:
    training = "[training.md](training.md)" if in_docs else "docs/training.md"
    ways = markdown_table(
        ("training", "what it is"),
        [(f"`{name}`", TRAINING_MEANINGS[name]) for name in settings.training],
    )
    return (
        "How the error falls with the number of examples, for every design of experiments and "
        f"every way to train, as measured by `{command(settings)}`. The designs are those of "
        f"{training}; the ways to train:\n\n{ways}"
    )


def _system_part(rows: Sequence[SummaryRow], settings: StudySettings) -> str:
    system = rows[0].system
    return "\n\n".join(
        part
        for part in (
            f"## {system}",
            f"![rms error of {system} against the number of examples]"
            f"({IMAGES}/{figure_name(system)})",
            _best_table(rows, settings.examples),
            _sentence(rows, max(settings.examples)),
            _all_table(rows, max(settings.examples)),
        )
        if part
    )


def _best_table(rows: Sequence[SummaryRow], budgets: Sequence[int]) -> str:
    """For each number of examples, the combination with the least median error."""
    unit = _bracketed(rows[0].unit)
    best = {budget: best_within(rows, budget) for budget in sorted(budgets)}
    return markdown_table(
        (
            "examples, at most",
            "design",
            "training",
            "examples",
            f"rms error{unit}",
            f"greatest error{unit}",
            "processor time [s]",
        ),
        [
            (
                str(budget),
                f"`{row.design}`",
                f"`{row.training}`",
                str(row.examples),
                _with_range(row.rms_error),
                _with_range(row.max_error),
                f"{row.seconds:.2g}",
            )
            for budget, row in best.items()
            if row is not None
        ],
    )


def _sentence(rows: Sequence[SummaryRow], most: int) -> str:
    """How many examples the other ways to train save."""
    plain = best_within([row for row in rows if row.training == "plain"], most)
    if plain is None:
        return ""
    few = fewest_reaching(rows, plain.rms_error.median)
    unit = f" {plain.unit}" if plain.unit else ""
    said = (
        f"With `plain` and at most {most} examples, `{plain.design}` with {plain.examples} is "
        f"best, with a median rms error of {error_text(plain.rms_error.median)}{unit}. "
    )
    if few.examples == plain.examples:
        return said + "No combination gets there with fewer examples."
    return said + (
        f"The fewest examples with which any combination gets there are {few.examples}: "
        f"`{few.design}` with `{few.training}`, {error_text(few.rms_error.median)}{unit}."
    )


def _all_table(rows: Sequence[SummaryRow], most: int) -> str:
    """Median errors of all combinations at the largest design of each within the budget."""
    trainings = list(dict.fromkeys(row.training for row in rows))
    largest: dict[str, int] = {}
    for row in rows:
        if row.examples <= most:
            largest[row.design] = max(row.examples, largest.get(row.design, 0))
    if not largest:
        return ""
    lines = []
    for design, examples in largest.items():
        at = {r.training: r for r in rows if (r.design, r.examples) == (design, examples)}
        lines.append(
            (
                f"`{design}`",
                str(examples),
                *(error_text(at[t].rms_error.median) if t in at else "" for t in trainings),
            )
        )
    unit = _bracketed(rows[0].unit)
    table = markdown_table(
        ("design", "examples", *(f"`{training}`{unit}" for training in trainings)), lines
    )
    return f"Median rms error of each design at its largest number up to {most}:\n\n{table}"


def _how_measured(outcome: StudyOutcome) -> str:
    settings = outcome.settings
    minutes = sum(found.seconds for found in outcome.outcomes.values()) / 60
    return (
        "## How it was measured\n\n"
        f"Median and range over {settings.seeds} seeds, of which each draws another random start "
        "and, where the design is random, another design. One start per fit, to all examples, "
        f"with at most {settings.max_evaluations} evaluations of the residual. The error is that "
        f"of the network on {TEST_EXAMPLES:,} random examples of the joint box, always the same "
        "ones: for inverse kinematics the distance between where the answer leads and the target, "
        "for a function the root mean square over its outputs. A design that can't have as many "
        "examples as asked has the nearest number that it can, and is drawn there. "
        f"Errors below {NEGLIGIBLE:.0e} count as none: among them the fewest examples win.\n\n"
        "An example with slopes (`sobolev`, `sobolev_bayesian`) holds more than one without: it "
        "comes with its Jacobian, which the robot's model gives and a measurement does not.\n\n"
        f"{len(outcome.outcomes)} fits took {minutes:.0f} minutes of processor time, "
        f"{minutes / settings.seeds:.1f} for each seed; the standard study has "
        f"{StudySettings().seeds} seeds. The processors share the jobs. {machine()}"
    )


def _not_measured(outcome: StudyOutcome) -> str:
    lines = [f"- {line}" for line in outcome.left_out]
    parts = []
    if lines:
        parts.append("Left out:\n\n" + "\n".join(lines))
    if outcome.failures:
        failed = [
            f"- {job.system}, {job.design} {job.size}, {job.training}, seed {job.seed}: {reason}"
            for job, reason in list(outcome.failures.items())[:_MOST_FAILURES]
        ]
        count = len(outcome.failures)
        shown = f", the first {_MOST_FAILURES}" if count > _MOST_FAILURES else ""
        parts.append(f"Failed ({count}{shown}):\n\n" + "\n".join(failed))
    return "\n\n".join(parts)


def _with_range(spread: Spread) -> str:
    median, least, greatest = map(error_text, (spread.median, spread.least, spread.greatest))
    return median if least == greatest else f"{median} ({least} to {greatest})"


def _bracketed(unit: str) -> str:
    return f" [{unit}]" if unit else ""
