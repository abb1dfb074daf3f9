"""The page about a study, in Markdown: figures, and tables of what was best."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from benchmarks.conditions import machine
from benchmarks.jobs.fit_job import TEST_EXAMPLES
from benchmarks.markdown import markdown_table
from benchmarks.pages import rendered
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
_TEMPLATE = Path(__file__).with_name("study.md.jinja")
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
    page = rendered(
        _TEMPLATE,
        command=command(settings),
        settings=settings,
        in_docs=in_docs,
        trainings=markdown_table(
            ("training", "what it is"),
            [(f"`{name}`", TRAINING_MEANINGS[name]) for name in settings.training],
        ),
        systems=[
            _system([row for row in rows if row.system == system], settings.examples)
            for system in dict.fromkeys(row.system for row in rows)
        ],
        most=max(settings.examples),
        test_examples=f"{TEST_EXAMPLES:,}",
        negligible=f"{NEGLIGIBLE:.0e}",
        fits=len(outcome.outcomes),
        minutes=sum(found.seconds for found in outcome.outcomes.values()) / 60,
        machine=machine(),
        left_out=outcome.left_out,
        failures=list(outcome.failures.items()),
        most_failures=_MOST_FAILURES,
    )
    return page.rstrip() + "\n"


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


def _system(rows: Sequence[SummaryRow], budgets: Sequence[int]) -> dict[str, Any]:
    """What the template says of a system, of which these are the rows."""
    most = max(budgets)
    plain = best_within([row for row in rows if row.training == "plain"], most)
    return {
        "name": rows[0].system,
        "figure": f"{IMAGES}/{figure_name(rows[0].system)}",
        "best": _best_table(rows, budgets),
        "plain": plain and _combination(plain),
        "fewest": plain and _combination(fewest_reaching(rows, plain.rms_error.median)),
        "largest": _largest_table(rows, most),
    }


def _combination(row: SummaryRow) -> dict[str, Any]:
    unit = f" {row.unit}" if row.unit else ""
    return {
        "design": row.design,
        "training": row.training,
        "examples": row.examples,
        "error": f"{error_text(row.rms_error.median)}{unit}",
    }


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


def _largest_table(rows: Sequence[SummaryRow], most: int) -> str:
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
    return markdown_table(
        ("design", "examples", *(f"`{training}`{unit}" for training in trainings)), lines
    )


def _with_range(spread: Spread) -> str:
    median, least, greatest = map(error_text, (spread.median, spread.least, spread.greatest))
    return median if least == greatest else f"{median} ({least} to {greatest})"


def _bracketed(unit: str) -> str:
    return f" [{unit}]" if unit else ""
