"""The figures of the reproduction, as PNG.

Colours are those of Okabe and Ito, which colour-blind people tell apart; line and marker differ
with them, so that a grey print loses nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, ScalarFormatter

from annik_core.pose import FloatArray
from benchmarks.paper import paper_values as printed
from benchmarks.paper.efficiency_experiment import ACCURACIES, TRAINING_TITLES
from benchmarks.paper.function_experiment import test_diagonal
from benchmarks.paper.reproduction import Measurements

_COLOURS: Final = {"thirty_phase": "#0072B2", "known": "#D55E00"}
_LINES: Final = {"thirty_phase": "-", "known": "--"}
_MARKERS: Final = {"thirty_phase": "o", "known": "s"}
_TRAINING: Final = {
    "plain": ("#D55E00", "s", "--"),
    "linear_path": ("#009E73", "^", "-."),
    "sobolev": ("#0072B2", "o", "-"),
}
_DOTS_PER_INCH: Final = 150
_BAND: Final = 0.18
#: Errors below this are drawn at it: smaller ones are rounding.
_FLOOR: Final = 1e-7
#: Errors of the paper that are printed as 0.0000 are drawn at half their last digit.
_PRINTED_FLOOR: Final = 5e-5


def paper_figures(measured: Measurements) -> dict[str, bytes]:
    """All figures: file name to PNG."""
    return {
        "function_errors.png": function_errors(measured),
        "path_errors.png": path_errors(measured),
        "workspace_errors.png": workspace_errors(measured),
        "fewest_examples.png": fewest_examples_figure(measured),
    }


def function_errors(measured: Measurements) -> bytes:
    """Tables 5 and 6: absolute errors of f1..f6 along the diagonal, both methods."""
    figure = _figure(9.0, 5.0)
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    degrees = np.degrees(test_diagonal()[:, 0])
    for output, axes in enumerate(panels.flat):
        for method in printed.METHODS:
            errors = np.abs([fold.test_errors[:, output] for fold in measured.functions[method]])
            _draw_band(axes, degrees, np.maximum(errors, _FLOOR), method)
        axes.set_title(f"$f_{output + 1}$")
        axes.set_yscale("log")
        axes.set_xlim(0, 90)
        axes.set_xticks([0, 30, 60, 90])
        axes.grid(alpha=0.3)
    for axes in panels[1]:
        axes.set_xlabel("all joints at [deg]")
    for axes in panels[:, 0]:
        axes.set_ylabel("absolute error")
    _legend(figure, panels.flat[0])
    return _png(figure)


def path_errors(measured: Measurements) -> bytes:
    """Table 10: position and orientation error along the path, three sets, both methods."""
    figure = _figure(9.0, 5.6)
    panels = figure.subplots(2, 3, sharex=True, sharey="row")
    points = np.arange(1, 16, dtype=np.float64)
    for column, name in enumerate(printed.SETS):
        position_axes, orientation_axes = panels[:, column]
        for method in printed.METHODS:
            outcome = measured.robot[method, name]
            _draw_path(
                position_axes, points, [start.path_position for start in outcome.starts], method
            )
            _draw_path(
                orientation_axes,
                points,
                [start.path_orientation for start in outcome.starts],
                method,
            )
            values = np.array(printed.TABLE_9[method][name])
            position_axes.plot(
                points[: len(values)],
                np.maximum(values, _PRINTED_FLOOR),
                linestyle="none",
                marker=_MARKERS[method],
                markerfacecolor="white",
                markeredgecolor=_COLOURS[method],
                markersize=4.5,
                label=f"{printed.METHOD_TITLES[method]}, as printed",
            )
        position_axes.set_title(printed.SET_TITLES[name])
        for axes in (position_axes, orientation_axes):
            axes.set_yscale("log")
            axes.grid(alpha=0.3)
            axes.set_xticks([1, 3, 5, 7, 9, 11, 13, 15])
        orientation_axes.set_xlabel("point of the path")
    panels[0, 0].set_ylabel("position error [mm]")
    panels[1, 0].set_ylabel("orientation error [deg]")
    _legend(figure, panels[0, 0])
    return _png(figure)


def workspace_errors(measured: Measurements) -> bytes:
    """What part of the workspace is reached within which position error, both methods."""
    figure = _figure(9.0, 3.3)
    panels = figure.subplots(1, 3, sharey=True, sharex=True)
    for name, axes in zip(printed.SETS, panels, strict=True):
        for method in printed.METHODS:
            curves = np.array([s.workspace_position for s in measured.robot[method, name].starts])
            part = 100.0 * (np.arange(curves.shape[1]) + 1.0) / curves.shape[1]
            colour = _COLOURS[method]
            axes.plot(
                np.median(curves, axis=0),
                part,
                _LINES[method],
                color=colour,
                label=printed.METHOD_TITLES[method],
            )
            axes.fill_betweenx(
                part, curves.min(axis=0), curves.max(axis=0), color=colour, alpha=_BAND, lw=0
            )
        axes.set_title(printed.SET_TITLES[name])
        axes.set_xscale("log")
        axes.set_xlabel("position error [mm]")
        axes.set_ylim(0, 100)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("random poses within it [%]")
    _legend(figure, panels[0])
    return _png(figure)


def fewest_examples_figure(measured: Measurements) -> bytes:
    """Error against number of Sobol examples: the robot and F, three ways to fit."""
    figure = _figure(9.0, 3.6)
    panels = figure.subplots(1, 2)
    for axes, system, measure, title, label in (
        (panels[0], "gantry", "max", "the robot", "greatest position error [mm]"),
        (panels[1], "F", "mse", "F", "mean square error"),
    ):
        for training, (colour, marker, line) in _TRAINING.items():
            by_size: dict[int, list[float]] = {}
            for job, outcome in measured.fits.items():
                if (job.system, job.design, job.training) == (system, "sobol", training):
                    value = outcome.error.max if measure == "max" else outcome.mean_square_error
                    by_size.setdefault(outcome.examples, []).append(value)
            if not by_size:
                continue
            sizes = sorted(by_size)
            errors = np.array([by_size[size] for size in sizes]).T
            axes.plot(
                sizes,
                np.median(errors, axis=0),
                line,
                color=colour,
                marker=marker,
                markersize=4,
                label=TRAINING_TITLES[training],
            )
            axes.fill_between(
                sizes, errors.min(axis=0), errors.max(axis=0), color=colour, alpha=_BAND, lw=0
            )
        for accuracy in ACCURACIES:
            if accuracy.system == system:
                axes.axhline(accuracy.bound, color="#666666", lw=0.8, ls=":")
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks([5, 7, 10, 14, 20, 30, 40, 60, 80])
        axes.xaxis.set_major_formatter(ScalarFormatter())
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(title)
        axes.set_xlabel("examples")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    _legend(figure, panels[0])
    return _png(figure)


def _draw_band(axes: Axes, x: FloatArray, curves: FloatArray, method: str) -> None:
    """Median of curves ``(networks, points)`` with the band between the least and greatest."""
    colour = _COLOURS[method]
    axes.plot(
        x,
        np.median(curves, axis=0),
        _LINES[method],
        color=colour,
        lw=1.4,
        label=printed.METHOD_TITLES[method],
    )
    axes.fill_between(x, curves.min(axis=0), curves.max(axis=0), color=colour, alpha=_BAND, lw=0)


def _draw_path(axes: Axes, points: FloatArray, curves: Sequence[FloatArray], method: str) -> None:
    _draw_band(axes, points, np.maximum(np.array(curves), _FLOOR), method)


def _legend(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    columns = len(labels) if len(labels) < 4 else 2
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False)


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def _png(figure: Figure) -> bytes:
    stream = BytesIO()
    # Without the version of matplotlib, so that the same data gives the same file.
    figure.savefig(stream, format="png", dpi=_DOTS_PER_INCH, metadata={"Software": None})
    return stream.getvalue()
