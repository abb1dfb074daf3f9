"""Figures of the command line: error map of a network, errors before and after calibration."""

from io import BytesIO
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_training.calibration.validation import REGIONS, MeasuredEvaluation
from annik_training.evaluation import NetworkErrors

_BLUE: Final = "#0072B2"
_VERMILLION: Final = "#D55E00"
_BINS: Final = 15
_CELLS: Final = 24
_COLUMNS: Final = 4


def error_map(errors: NetworkErrors, dots_per_inch: int = 150) -> bytes:
    """Map of a network's errors over the joint box and the workspace, as PNG.

    One panel per joint: position error against the joint's position, as median and 99th
    percentile, with a mark at every pose that a node does not solve. One more panel: median
    error by distance from the base axis and height.
    """
    robot = errors.dataset.robot
    free = robot.joint_box.free
    rows = -(-(len(free) + 1) // _COLUMNS)
    size = 2.6 * _COLUMNS, 2.3 * rows + 0.5
    figure = Figure(figsize=size, dpi=dots_per_inch, layout="constrained")
    axes = list(figure.subplots(rows, _COLUMNS, squeeze=False).flat)
    errors_mm = np.maximum(1e3 * errors.distances, 1e-9)
    failed = np.zeros(len(errors_mm), dtype=np.bool_)
    if errors.unsolved is not None:
        failed = errors.unsolved
    for axis, joint in zip(axes, free, strict=False):
        turns = robot.joint_types[joint] != "prismatic"
        positions = errors.dataset.joint_positions[:, joint]
        shown = np.degrees(positions) if turns else positions
        _draw_joint(axis, shown, errors_mm, failed)
        axis.set_xlabel(
            f"{_plain(robot.joint_names[joint])} [{'deg' if turns else 'm'}]", fontsize=8
        )
    axes[0].set_ylabel("position error [mm]", fontsize=8)
    axes[0].legend(fontsize=6)
    _draw_workspace(figure, axes[len(free)], errors.dataset.poses, errors_mm)
    for axis in axes[len(free) + 1 :]:
        axis.set_axis_off()
    for axis in axes:
        axis.tick_params(labelsize=7)
    not_solved = "" if errors.unsolved is None else f"; {failed.sum()} not solved"
    figure.suptitle(
        f"{_plain(robot.name)}: error of the network alone, {len(errors_mm)} random poses"
        f"{not_solved}",
        fontsize=9,
    )
    return png(figure)


def png(figure: Figure) -> bytes:
    """A figure in its own resolution."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def _plain(name: str) -> str:
    """A name without mathematics, which matplotlib reads between dollar signs."""
    return name.replace("$", r"\$")


def _draw_joint(
    axis: Axes, positions: FloatArray, errors_mm: FloatArray, failed: NDArray[np.bool_]
) -> None:
    edges = np.linspace(positions.min(), positions.max(), _BINS + 1)
    cells = np.clip(np.digitize(positions, edges) - 1, 0, _BINS - 1)
    middles = 0.5 * (edges[:-1] + edges[1:])
    for percent, colour, label in ((50, _BLUE, "median"), (99, _VERMILLION, "99th percentile")):
        values = [
            np.percentile(errors_mm[cells == cell], percent) if (cells == cell).any() else np.nan
            for cell in range(_BINS)
        ]
        axis.plot(middles, values, color=colour, label=label, linewidth=1.2)
    if failed.any():
        axis.plot(
            positions[failed],
            np.full(int(failed.sum()), 0.03),
            "|",
            color="black",
            transform=axis.get_xaxis_transform(),
            label="not solved",
        )
    axis.set_yscale("log")
    axis.grid(alpha=0.3, linewidth=0.5)


def _draw_workspace(figure: Figure, axis: Axes, poses: FloatArray, errors_mm: FloatArray) -> None:
    radius, height = np.hypot(poses[:, 0], poses[:, 1]), poses[:, 2]
    horizontal, vertical = (
        np.linspace(values.min(), values.max() + 1e-9, _CELLS + 1) for values in (radius, height)
    )
    columns = np.digitize(radius, horizontal) - 1
    lines = np.digitize(height, vertical) - 1
    medians = np.full((_CELLS, _CELLS), np.nan)
    for line, column in {*zip(lines.tolist(), columns.tolist(), strict=True)}:
        here = (lines == line) & (columns == column)
        medians[line, column] = np.median(errors_mm[here])
    mesh = axis.pcolormesh(
        horizontal, vertical, medians, norm=LogNorm(), cmap="viridis", rasterized=True
    )
    colours = figure.colorbar(mesh, ax=axis)
    colours.ax.tick_params(labelsize=6)
    colours.set_label("median error [mm]", fontsize=7)
    axis.set_xlabel("distance from the base axis [m]", fontsize=8)
    axis.set_ylabel("height [m]", fontsize=8)
    axis.set_aspect("equal")


_MILLIMETRE = 1e3
_THIRDS = ("lower", "middle", "upper")
_MARKERS = "<o>"


def before_and_after(evaluation: MeasuredEvaluation) -> bytes:
    """Errors at held-out poses before and after a calibration, as PNG.

    The error of every pose, sorted, and the mean by joint and region.
    """
    figure = Figure(figsize=(11, 4.5), dpi=110, layout="constrained")
    curves, regions = figure.subplots(1, 2)
    share = 100 * (np.arange(len(evaluation.dataset)) + 1) / len(evaluation.dataset)
    for label, errors, style in (
        ("nominal model", evaluation.before.distances, "tab:red"),
        ("calibrated model", evaluation.after.distances, "tab:blue"),
    ):
        ordered = _MILLIMETRE * np.sort(errors)
        curves.plot(share, ordered, color=style, label=f"{label}: mean {ordered.mean():.3g} mm")
    bound = _MILLIMETRE * np.sort(evaluation.bounds_of_measurements[:, 0])
    curves.plot(share, bound, color="tab:blue", linestyle=":", label="its stated 95 % bound")
    curves.set_yscale("log")
    curves.set_xlabel("held-out poses [%]")
    curves.set_ylabel("position error [mm]")
    curves.set_title(f"{len(evaluation.dataset)} poses that were not calibrated with")
    curves.grid(visible=True, which="both", alpha=0.3)
    curves.legend()
    joints = list(dict.fromkeys(region.joint for region in evaluation.regions))
    for shade, marker in enumerate(_MARKERS):
        rows = evaluation.regions[shade::REGIONS]
        places = np.arange(len(joints)) + 0.2 * (shade - 1)
        for label, colour, values in (
            ("nominal", "tab:red", [region.before for region in rows]),
            ("calibrated", "tab:blue", [region.after for region in rows]),
        ):
            regions.plot(
                _MILLIMETRE * np.array(values),
                places,
                marker,
                color=colour,
                label=f"{label}, {_THIRDS[shade]} third",
            )
    regions.set_xscale("log")
    regions.set_yticks(range(len(joints)), joints)
    regions.invert_yaxis()
    regions.set_xlabel("mean position error [mm]")
    regions.set_title("by joint and part of the joint box")
    regions.grid(visible=True, axis="x", which="both", alpha=0.3)
    regions.legend(loc="center")
    return png(figure)
