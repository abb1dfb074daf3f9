"""docs/paper.md: the reproduction side by side with the paper.

The template has the words; all numbers are those of the results, and of the paper.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.markdown import markdown_table
from benchmarks.pages import rendered
from benchmarks.paper import paper_values as printed
from benchmarks.paper.efficiency_experiment import ACCURACIES, DESIGNS, TRAINING_TITLES

_TEMPLATE = Path(__file__).with_name("paper.md.jinja")
#: Method and set of the columns of Table 9, with the title of the column.
_COLUMNS = {
    (method, name): f"{short} {printed.SET_TITLES[name]}"
    for method, short in (("thirty_phase", "PrM"), ("known", "KnM"))
    for name in printed.SETS
}
_POINTS = 15


def paper_document(results: Mapping[str, Any], images: str, machine: str) -> str:
    """The page in Markdown.

    Args:
        results: see :func:`benchmarks.paper.results.results`.
        images: where the figures are, relative to the page, with the beginning of their names.
        machine: what it ran on, for the line with the time.
    """
    return rendered(
        _TEMPLATE,
        {"number": _number},
        results=results,
        images=images,
        machine=machine,
        table=_tables(results),
    )


def _tables(results: Mapping[str, Any]) -> dict[str, str]:
    """The tables of the page, by the names that the template uses."""
    counts = results["counts"]
    titles = [f"{title}: {counts[method][name]}" for (method, name), title in _COLUMNS.items()]
    return {
        "sets": _sets(counts),
        "table4": _table_4(results["table4"]),
        "path": markdown_table(("position error [mm]", *titles), _path_rows(results["table9"])),
        "points": markdown_table(("point", *_COLUMNS.values()), _point_rows(results["table9"])),
        "workspace": markdown_table(
            ("position error [mm]", *_COLUMNS.values()), _workspace_rows(results["workspace"])
        ),
        "fewest": _fewest(results["fewest"]),
        "interaction": _interaction(results["blind"]),
    }


def _sets(counts: Mapping[str, Any]) -> str:
    titles = {
        "set1": "Set 1: j = 3",
        "set2": "Set 2: j = 6",
        "set3": "Set 3: j = 15",
        "section2": "section 2: j = 18",
    }
    return markdown_table(
        ("set", "PrM here", "PrM printed", "KnM here", "KnM printed"),
        [
            (
                title,
                *(
                    f"{source[method][name]}"
                    for method in printed.METHODS
                    for source in (counts, printed.COUNTS)
                ),
            )
            for name, title in titles.items()
        ],
    )


def _table_4(table: Mapping[str, Any]) -> str:
    return markdown_table(
        ("method", "here", "printed, four networks", "training error, scaled"),
        [
            (
                printed.METHOD_TITLES[method],
                f"{_number(table[method]['mse'])} ({_range(table[method]['range'])})",
                ", ".join(map(_number, printed.TABLE_4[method])),
                _number(table[method]["training_mse_scaled"]),
            )
            for method in printed.METHODS
        ],
    )


def _path_rows(table: Mapping[str, Any]) -> list[Sequence[str]]:
    """Table 9, summed up over the path."""
    sets = [table[method][name] for method, name in _COLUMNS]
    position = [found["position_error_mm"] for found in sets]
    return [
        (
            "worst of 9, printed",
            *(_number(max(printed.TABLE_9[method][name])) for method, name in _COLUMNS),
        ),
        (
            "whole path, claimed in its conclusions",
            *(printed.CONCLUSIONS.get(column, "-") for column in _COLUMNS),
        ),
        ("worst of 9, chosen network", *(_number(found["max9"]) for found in position)),
        ("worst of 15, chosen network", *(_number(found["max15"]) for found in position)),
        ("worst of 9, median", *(_number(found["median_over_seeds"]) for found in position)),
        ("range", *(_range(found["range"]) for found in position)),
        (
            "orientation, worst of 15 [deg]",
            *(_number(found["orientation_error_deg"]["max15"]) for found in sets),
        ),
    ]


def _point_rows(table: Mapping[str, Any]) -> list[Sequence[str]]:
    """Chosen network / printed, point by point."""

    def cell(method: str, name: str, point: int) -> str:
        values = printed.TABLE_9[method][name]
        beside = values[point] if point < len(values) else "-"
        found = table[method][name]["position_error_mm"]["points"][point]
        return f"{_number(found)} / {beside}"

    return [
        (f"{point + 1}", *(cell(method, name, point) for method, name in _COLUMNS))
        for point in range(_POINTS)
    ]


def _workspace_rows(table: Mapping[str, Any]) -> list[Sequence[str]]:
    errors = [table[method][name]["position_error_mm"] for method, name in _COLUMNS]
    titles = {"rms": "rms", "max": "greatest"}
    return [
        *(
            (title, *(f"{_number(e[key])} ({_range(e[f'{key}_range'])})" for e in errors))
            for key, title in titles.items()
        ),
        *(
            (f"{title}, chosen network", *(_number(e["chosen_network"][key]) for e in errors))
            for key, title in titles.items()
        ),
    ]


def _fewest(found: Mapping[str, Any]) -> str:
    columns = [(training, design) for training in TRAINING_TITLES for design in DESIGNS]
    rows = []
    for accuracy in ACCURACIES:
        examples = {
            (entry["training"], entry["design"]): entry["examples"]
            for entry in found[accuracy.system][f"{accuracy.name}_all"]
        }
        # A quick run does not try all of them.
        cells = [examples.get(column) for column in columns]
        rows.append((accuracy.meaning, *(f"{cell or 'not reached'}" for cell in cells)))
    header = [f"{TRAINING_TITLES[training]}, {design}" for training, design in columns]
    return markdown_table(("accuracy", *header), rows)


def _interaction(blind: Mapping[str, Any]) -> str:
    return markdown_table(
        ("way to fit", "thirty_phase", "thirty_phase_plus", "ratio"),
        [
            (
                title,
                _number(blind["thirty_phase"]["interaction_rms"][training]),
                _number(blind["thirty_phase_plus"]["interaction_rms"][training]),
                _number(blind["interaction_ratio"][training]),
            )
            for training, title in TRAINING_TITLES.items()
        ],
    )


def _number(value: float) -> str:
    """Two significant digits: the seeds differ in the first."""
    if value == 0:
        return "0"
    text = f"{value:.1e}" if value < 1e-3 or value >= 1e4 else f"{float(f'{value:.1e}'):g}"
    return text.replace("e-0", "e-").replace("e+0", "e")


def _range(values: Sequence[float]) -> str:
    return f"{_number(values[0])} to {_number(values[1])}"
