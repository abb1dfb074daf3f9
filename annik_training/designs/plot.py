"""Pair plot of a design of experiments: its examples, two joints at a time.

Colours of Okabe and Ito, distinct to colour-blind readers; markers and frames differ too, for
prints without colour.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.diagnostics import DesignDiagnostics

_BLUE: Final = "#0072B2"
_VERMILLION: Final = "#D55E00"
_GREY: Final = "#999999"
_DOTS_PER_INCH: Final = 200
#: Width of all panels [in]: with the labels, two columns of a journal.
_PANELS_WIDTH: Final = 6.4
_LEAST_PANEL, _LARGEST_PANEL = 0.85, 1.5
#: Fraction of a panel's cell that the panel fills.
_FILLED: Final = 0.93
#: Margins for the labels, the title, and the legend beside the first panel [in].
_LEFT, _RIGHT, _BELOW, _ABOVE, _LEGEND = 0.9, 0.2, 0.7, 0.35, 3.5
#: Distance of the joint names from a panel [in].
_TO_NAME_LEFT, _TO_NAME_BELOW = 0.36, 0.16
#: Font sizes and mean letter width [pt].
_SMALL, _TEXT, _TITLE, _LETTER = 6.0, 7.0, 9.0, 3.9
#: A prime, so that the steps of a sweep don't fall on bin edges.
_BINS: Final = 13
#: Most examples that a panel shows; of more, every n-th is drawn.
_MOST_DRAWN: Final = 4000
#: Positions closer than this fraction of the interval are drawn as one.
_SAME: Final = 1e-6


def pair_figure(
    joint_positions: FloatArray,
    box: JointLimits,
    joint_types: Sequence[str],
    diagnostics: DesignDiagnostics,
    title: str,
) -> Figure:
    """A scatter plot for each pair of joints, and a histogram for each joint.

    Blind pairs (:attr:`DesignDiagnostics.blind_interactions`) are framed and have another marker.
    Locked joints are left out; at least one is not locked. A ``prismatic`` joint is drawn in mm or
    m, another in degrees.
    """
    joints = _joint_axes(joint_positions, box, joint_types)
    blind = {frozenset(pair) for pair in diagnostics.blind_interactions}
    panel = float(np.clip(_PANELS_WIDTH / len(joints), _LEAST_PANEL, _LARGEST_PANEL))
    figure = _figure(len(joints), panel)
    last = len(joints) - 1
    histograms = []
    for row, up in enumerate(joints):
        for column, across in enumerate(joints[:row]):
            axes = _add_panel(figure, panel, last, row, column)
            _draw_pair(axes, across, up, frozenset((across.name, up.name)) in blind)
            _label_across(axes, across, panel, is_named=row == last)
            _label_up(axes, up, panel, is_named=column == 0)
        histograms.append(_add_panel(figure, panel, last, row, row))
        _draw_histogram(histograms[-1], up)
        _label_across(histograms[-1], up, panel, is_named=row == last)
    highest = max(axes.get_ylim()[1] for axes in histograms)
    for axes in histograms:
        axes.set_ylim(0.0, highest)
    _add_title(figure, title)
    _add_legend(figure, diagnostics, _left_out(len(joint_positions), box))
    return figure


def _figure(joints: int, panel: float) -> Figure:
    """An empty figure with room for the panels and the legend."""
    width = _LEFT + max(joints * panel, panel + _LEGEND) + _RIGHT
    height = _ABOVE + joints * panel + _BELOW
    return Figure(figsize=(width, height), dpi=_DOTS_PER_INCH)


def _add_panel(figure: Figure, panel: float, last: int, row: int, column: int) -> Axes:
    width, height = figure.get_size_inches()
    left, bottom = _LEFT + column * panel, _BELOW + (last - row) * panel
    side = _FILLED * panel
    axes = figure.add_axes((left / width, bottom / height, side / width, side / height))
    for spine in axes.spines.values():
        spine.set_linewidth(0.6)
    axes.tick_params(labelsize=_SMALL, length=2.0, width=0.5, pad=1.5)
    return axes


def _draw_pair(axes: Axes, across: "_JointAxis", up: "_JointAxis", is_blind: bool) -> None:
    """Scatter plot of two joints; markers grow with the number of coinciding examples."""
    drawn = np.stack([across.positions, up.positions], axis=1)[:: _drawn_every(len(up.positions))]
    widths = np.array([across.upper - across.lower, up.upper - up.lower])
    _, first, counts = np.unique(
        np.rint(drawn / (_SAME * widths)), axis=0, return_index=True, return_counts=True
    )
    marker = _marker(is_blind)
    size = np.clip(25.0 / np.sqrt(len(drawn)), 0.8, 2.2)
    axes.scatter(
        drawn[first, 0],
        drawn[first, 1],
        s=size**2 * np.sqrt(counts),
        marker=marker["marker"],
        color=marker["color"],
        linewidths=0.0,
        zorder=2.5,
    )
    if is_blind:
        for spine in axes.spines.values():
            spine.set(color=marker["color"], linewidth=1.5)


def _drawn_every(examples: int) -> int:
    return -(-examples // _MOST_DRAWN)


def _draw_histogram(axes: Axes, joint: "_JointAxis") -> None:
    axes.hist(
        joint.positions, bins=_BINS, range=(joint.lower, joint.upper), color=_GREY, rwidth=0.85
    )
    # On the right: the left side shows joint positions.
    axes.yaxis.tick_right()
    axes.yaxis.set_major_locator(MaxNLocator(2, integer=True, min_n_ticks=2))


def _label_across(axes: Axes, joint: "_JointAxis", panel: float, *, is_named: bool) -> None:
    axes.set_xlim(joint.shown)
    axes.set_xticks(joint.ticks, labels=joint.numbers if is_named else [])
    if is_named:
        if len("".join(joint.numbers)) > 0.6 * _letters(panel):
            _keep_apart(axes.get_xticklabels())
        # Without mathematics: a name may contain dollar signs.
        axes.set_xlabel(joint.label(_letters(panel)), fontsize=_TEXT, parse_math=False)
        axes.xaxis.set_label_coords(0.5, -_TO_NAME_BELOW / (_FILLED * panel))


def _keep_apart(numbers: Sequence[Text]) -> None:
    """Hide the number at the median, and align the outer ones inwards."""
    lower, median, upper = numbers
    lower.set_horizontalalignment("left")
    median.set_visible(False)
    upper.set_horizontalalignment("right")


def _label_up(axes: Axes, joint: "_JointAxis", panel: float, *, is_named: bool) -> None:
    axes.set_ylim(joint.shown)
    axes.set_yticks(joint.ticks, labels=joint.numbers if is_named else [])
    if is_named:
        axes.set_ylabel(joint.label(_letters(panel)), fontsize=_TEXT, parse_math=False)
        axes.yaxis.set_label_coords(-_TO_NAME_LEFT / (_FILLED * panel), 0.5)


def _letters(panel: float) -> int:
    """Number of letters that fit along a panel."""
    return int(72.0 * panel / _LETTER)


def _add_title(figure: Figure, title: str) -> None:
    width, height = figure.get_size_inches()
    figure.text(
        _LEFT / width,
        1.0 - 0.5 * _ABOVE / height,
        title,
        va="center",
        fontsize=_TITLE,
        parse_math=False,
    )


def _add_legend(figure: Figure, diagnostics: DesignDiagnostics, left_out: Sequence[str]) -> None:
    """Key of the markers, and the diagnostics, beside the first panel."""
    width, height = figure.get_size_inches()
    keys: list[Line2D | Patch] = [
        _key("example; larger where several coincide in this view", is_blind=False),
        Patch(color=_GREY, label="number of examples by the position of one joint"),
    ]
    if diagnostics.blind_interactions:
        blind = (
            "the same for a blind pair, framed: the product of\n"
            "its joints can't be told from other such products"
        )
        keys.insert(1, _key(blind, is_blind=True))
    legend = figure.legend(
        handles=keys,
        title="\n".join([str(diagnostics), *left_out]),
        loc="upper right",
        bbox_to_anchor=(1.0 - _RIGHT / width, 1.0 - _ABOVE / height),
        fontsize=_TEXT,
        title_fontsize=_TEXT,
        alignment="left",
        frameon=False,
        borderpad=0.0,
        borderaxespad=0.0,
    )
    legend.get_title().set_parse_math(False)


def _left_out(examples: int, box: JointLimits) -> list[str]:
    """Lines on what the panels don't show."""
    lines = []
    locked = np.delete(box.joint_names, box.free)
    if len(locked):
        lines.append(f"locked: {', '.join(locked)}")
    every = _drawn_every(examples)
    if every > 1:
        lines.append(f"of the examples one in {every} is drawn")
    return lines


def _key(label: str, *, is_blind: bool) -> Line2D:
    return Line2D([], [], linestyle="", markersize=3.5, label=label, **_marker(is_blind))


def _marker(is_blind: bool) -> dict[str, Any]:
    marker, colour = ("^", _VERMILLION) if is_blind else ("o", _BLUE)
    return {"marker": marker, "color": colour, "markeredgewidth": 0.0}


@dataclass(frozen=True, eq=False)
class _JointAxis:
    """A joint that is not locked; positions and joint box in the unit deg, mm or m."""

    name: str
    unit: str
    positions: FloatArray
    lower: float
    upper: float

    @property
    def shown(self) -> tuple[float, float]:
        """Limits of the axis: the interval and a margin for the markers."""
        margin = 0.09 * (self.upper - self.lower)
        return self.lower - margin, self.upper + margin

    @property
    def ticks(self) -> list[float]:
        """Minimum, median and maximum, the levels of the designs."""
        return [self.lower, 0.5 * (self.lower + self.upper), self.upper]

    @property
    def numbers(self) -> list[str]:
        """The ticks as text."""
        return [f"{tick:.3g}" for tick in self.ticks]

    def label(self, letters: int) -> str:
        """Name and unit, broken at underscores into lines of at most so many letters."""
        lines = [""]
        for part in self.name.replace("_", "_\n").split("\n"):
            if lines[-1] and len(lines[-1]) + len(part) > letters:
                lines.append("")
            lines[-1] += part
        return "\n".join([*lines, f"[{self.unit}]"])


def _joint_axes(
    joint_positions: FloatArray, box: JointLimits, joint_types: Sequence[str]
) -> list[_JointAxis]:
    """Axes of the joints that are not locked, in order."""
    axes = []
    for joint in box.free:
        lower, upper = float(box.lower[joint]), float(box.upper[joint])
        unit, scale = _unit(joint_types[joint], max(abs(lower), abs(upper)))
        positions = scale * joint_positions[:, joint]
        axes.append(
            _JointAxis(box.joint_names[joint], unit, positions, scale * lower, scale * upper)
        )
    return axes


def _unit(joint_type: str, largest: float) -> tuple[str, float]:
    """Unit for positions of at most ``largest`` [rad or m], and the factor to it."""
    if joint_type != "prismatic":
        return "deg", 180.0 / np.pi
    return ("mm", 1000.0) if largest < 1.0 else ("m", 1.0)
