"""The figures of a study, as PNG: error against number of examples, one panel per training option.

Colours are those of Okabe and Ito, which colour-blind people tell apart (but grey in place of
their yellow, which is too light for a line); designs also differ in marker and line, so that a
grey print loses nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator, ScalarFormatter

from annik_training.cli.plots import png
from annik_training.designs.registry import DESIGNS
from benchmarks.study.summary import NEGLIGIBLE, SummaryRow

_COLOURS: Final = (
    "#000000",
    "#E69F00",
    "#56B4E9",
    "#009E73",
    "#0072B2",
    "#D55E00",
    "#CC79A7",
    "#777777",
    "#882255",
)
_MARKERS: Final = ("o", "s", "^", "v", "D", "P", "X", "*", "p")
_LINES: Final = ("-", "--", "-.", (0, (1, 1.2)))
_GREY: Final = "#666666"
_DOTS_PER_INCH: Final = 200
#: Of a panel [in]: three of them are as wide as two columns of a journal.
_PANEL_WIDTH, _PANEL_HEIGHT = 2.35, 2.15
_LEGEND_WIDTH: Final = 1.7
#: Up to this ratio of greatest to least error, powers of ten are too few marks for an axis.
_FEW_DECADES: Final = 300.0
#: Sizes of letters [pt].
_SMALL, _TEXT, _TITLE = 7.0, 8.0, 9.0


def efficiency_plot(rows: Sequence[SummaryRow], wanted: Sequence[int]) -> bytes:
    """What :func:`efficiency_figure` draws, as PNG."""
    return png(efficiency_figure(rows, wanted))


def efficiency_figure(rows: Sequence[SummaryRow], wanted: Sequence[int]) -> Figure:
    """Median rms error and its range over the seeds, against the number of examples.

    Args:
        rows: of one system, at least one.
        wanted: the numbers of examples on the axis.
    """
    trainings = list(dict.fromkeys(row.training for row in rows))
    designs = list(dict.fromkeys(row.design for row in rows))
    columns = _columns(len(trainings))
    lines = -(-len(trainings) // columns)
    has_room = len(trainings) < lines * columns
    width = columns * _PANEL_WIDTH + (0.0 if has_room else _LEGEND_WIDTH)
    figure = Figure(
        figsize=(width, lines * _PANEL_HEIGHT + 0.3), dpi=_DOTS_PER_INCH, layout="constrained"
    )
    panels = figure.subplots(lines, columns, squeeze=False, sharex=True, sharey=True).ravel()
    lowest = _lowest(rows)
    for number, training in enumerate(trainings):
        panel = panels[number]
        _draw_panel(panel, [row for row in rows if row.training == training], designs, lowest)
        panel.set_title(training, fontsize=_TEXT, fontweight="bold")
        # Also above the legend, which has no axis.
        panel.tick_params(labelbottom=number + columns >= len(trainings))
    for panel in panels[len(trainings) :]:
        panel.set_axis_off()
    _set_axes(panels[0], rows, wanted, lowest)
    if has_room:
        panels[-1].legend(loc="center", **_legend(designs))
    else:
        figure.legend(loc="outside right center", **_legend(designs))
    seeds = max(row.seeds for row in rows)
    over = f"median and range over {seeds} seeds" if seeds > 1 else "one seed"
    figure.suptitle(f"{rows[0].system}: {over}", fontsize=_TITLE, parse_math=False)
    figure.supxlabel("number of examples", fontsize=_TEXT)
    figure.supylabel(
        f"rms error [{rows[0].unit}]" if rows[0].unit else "rms error", fontsize=_TEXT
    )
    return figure


def _lowest(rows: Sequence[SummaryRow]) -> float:
    """Where the axis of the errors begins."""
    return max(min(row.rms_error.least for row in rows), NEGLIGIBLE)


def _draw_panel(
    axes: Axes, rows: Sequence[SummaryRow], designs: Sequence[str], lowest: float
) -> None:
    axes.grid(which="major", alpha=0.3, linewidth=0.5)
    axes.tick_params(labelsize=_SMALL, length=2.5, width=0.6)
    for spine in axes.spines.values():
        spine.set_linewidth(0.6)
    is_below = False
    for design in designs:
        series = sorted((row for row in rows if row.design == design), key=lambda r: r.examples)
        if not series:
            continue
        is_below |= any(row.rms_error.median < NEGLIGIBLE for row in series)
        style = _style(design, designs)
        examples = [row.examples for row in series]
        median, least, greatest = (
            np.maximum([getattr(row.rms_error, name) for row in series], lowest)
            for name in ("median", "least", "greatest")
        )
        axes.plot(examples, median, **style)
        if len(series) > 1:
            axes.fill_between(
                examples, least, greatest, color=style["color"], alpha=0.12, linewidth=0.0
            )
        else:
            axes.vlines(examples, least, greatest, color=style["color"], alpha=0.4, linewidth=2.5)
    if is_below:
        axes.text(
            0.5,
            0.05,
            f"on the axis: below {NEGLIGIBLE:.0e} {rows[0].unit}".rstrip(),
            transform=axes.transAxes,
            ha="center",
            fontsize=_SMALL,
            color=_GREY,
        )


def _style(design: str, designs: Iterable[str]) -> dict[str, Any]:
    """The same for a design in every figure; what is not registered comes after what is."""
    number = list(dict.fromkeys([*DESIGNS, *designs])).index(design)
    marker = _MARKERS[number % len(_MARKERS)]
    return {
        "color": _COLOURS[number % len(_COLOURS)],
        "marker": marker,
        "linestyle": _LINES[number % len(_LINES)],
        "linewidth": 1.1,
        "markersize": 5.5 if marker == "*" else 3.8,
        "markeredgewidth": 0.4,
        "markeredgecolor": "white",
        "clip_on": False,
    }


def _set_axes(
    axes: Axes, rows: Sequence[SummaryRow], wanted: Sequence[int], lowest: float
) -> None:
    """Logarithmic axes, which all panels share, with the wanted numbers of examples."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    counts = [*wanted, *(row.examples for row in rows)]
    axes.set_xlim(min(counts) / 1.15, max(counts) * 1.15)
    axes.xaxis.set_major_locator(FixedLocator(sorted(wanted)))
    axes.xaxis.set_major_formatter(ScalarFormatter())
    axes.xaxis.set_minor_locator(NullLocator())
    greatest = max(max(row.rms_error.greatest for row in rows), lowest * 2.0)
    axes.set_ylim(lowest / 1.5, greatest * 1.5)
    axes.yaxis.set_minor_locator(NullLocator())
    if greatest < _FEW_DECADES * lowest:
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda error, _: f"{error:g}"))
    else:
        axes.yaxis.set_major_locator(LogLocator(numticks=9))


def _legend(designs: Sequence[str]) -> dict[str, Any]:
    keys: list[Line2D | Patch] = [
        Line2D([], [], label=design, **_style(design, designs)) for design in designs
    ]
    keys.append(Patch(color=_GREY, alpha=0.25, linewidth=0.0, label="range over the seeds"))
    return {
        "handles": keys,
        "title": "design of experiments",
        "fontsize": _SMALL,
        "title_fontsize": _TEXT,
        "frameon": False,
        "handlelength": 3.2,
    }


def _columns(panels: int) -> int:
    """As few lines as fit on a page, with no more empty places than one."""
    return {1: 1, 2: 2, 4: 2}.get(panels, 3)
