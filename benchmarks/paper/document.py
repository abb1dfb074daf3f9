"""docs/paper.md: the reproduction side by side with the paper. All numbers are the results'."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from typing import Any

import jinja2

from benchmarks.paper import paper_values as printed
from benchmarks.paper.efficiency_experiment import ACCURACIES, DESIGNS, TRAINING_TITLES

_TEMPLATE = "paper.md.jinja"


def paper_document(results: Mapping[str, Any], images: str, machine: str) -> str:
    """The page in Markdown.

    Args:
        results: see :func:`benchmarks.paper.results.results`.
        images: where the figures are, relative to the page, with the beginning of their names.
        machine: what it ran on, for the line with the time.
    """
    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    environment.filters.update(number=_number, range=_range, worst=max)
    template = environment.from_string(
        resources.files(__package__).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    )
    text = template.render(
        results=results,
        printed=printed,
        images=images,
        machine=machine,
        accuracies=ACCURACIES,
        designs=DESIGNS,
        training_titles=TRAINING_TITLES,
    )
    return "\n".join(line.rstrip() for line in text.split("\n"))


def _number(value: float | None) -> str:
    """Two significant digits: more would change from one processor to the next."""
    if value is None:
        return "not reached"
    if value == 0:
        return "0"
    text = f"{value:.1e}" if value < 1e-3 or value >= 1e4 else f"{float(f'{value:.1e}'):g}"
    return text.replace("e-0", "e-").replace("e+0", "e")


def _range(values: tuple[float, float]) -> str:
    return f"{_number(values[0])} to {_number(values[1])}"
