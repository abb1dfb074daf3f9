"""Plots of a report as PNG: errors, path, latency.

Colours are those of Okabe and Ito, for colour-blind readers; lines and markers differ in a grey
print too.
"""

from collections.abc import Sequence
from io import BytesIO
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from annik_core.pose import FloatArray
from msg_tools.report.tracking import TrackingReport

_BLUE: Final = "#0072B2"
_ORANGE: Final = "#E69F00"
_GREY: Final = "#666666"
_DOTS_PER_INCH: Final = 120
#: Each target has a marker up to so many targets.
_MARKED_TARGETS: Final = 200
_BINS: Final = 40
#: Values whose relative spread is at most this are drawn as one value.
_SAME: Final = 1e-6
#: Values up to this [mm or deg] are drawn as zero: an axis can't be divided further.
_NOTHING: Final = 1e-30
#: The axis is logarithmic above this ratio of largest to median error.
_LOGARITHMIC_RATIO: Final = 30.0


def report_plots(report: TrackingReport) -> dict[str, bytes]:
    """All pictures of a report: file name to PNG."""
    return {
        "errors.png": errors_plot(report),
        "path.png": path_plot(report),
        "histogram.png": histogram_plot(report),
        "latency.png": latency_plot(report),
    }


def errors_plot(report: TrackingReport) -> bytes:
    """Position error [mm] and orientation error [deg] of each target, as PNG."""
    figure = _figure(8.0, 5.2)
    upper, lower = figure.subplots(2, 1, sharex=True)
    numbers = [target.number for target in report.targets]
    distances, angles = _errors(report)
    _draw_series(upper, numbers, distances, _BLUE, "position error [mm]")
    _draw_series(lower, numbers, angles, _ORANGE, "orientation error [deg]")
    upper.set_title("Tracking error along the path")
    lower.set_xlabel("target number")
    lower.xaxis.set_major_locator(MaxNLocator(integer=True))
    return _png(figure)


def path_plot(report: TrackingReport) -> bytes:
    """Target and achieved positions [m] in three dimensions, as PNG."""
    figure = _figure(7.0, 6.0)
    axes: Axes3D = figure.add_subplot(projection="3d")
    axes.set_title("Target and achieved path")
    targets = np.array([target.target for target in report.targets]).reshape(-1, 3)
    achieved = np.array([target.achieved for target in report.targets]).reshape(-1, 3)
    # Wide under narrow: the two coincide where the errors are small.
    axes.plot(*targets.T, color=_ORANGE, linewidth=6.0, label="target")
    axes.plot(*achieved.T, color=_BLUE, linewidth=1.5, label="achieved")
    if len(targets):
        axes.scatter(*targets[0], color="black", marker="^", s=40, label="first target")
        axes.legend(loc="upper left")
        _set_equal_scales(axes, np.concatenate([targets, achieved]))
    else:
        axes.text2D(0.5, 0.5, "no matching pairs", ha="center", transform=axes.transAxes)
    axes.set_xlabel("x [m]", labelpad=8)
    axes.set_ylabel("y [m]", labelpad=8)
    axes.set_zlabel("z [m]", labelpad=8)
    return _png(figure)


def histogram_plot(report: TrackingReport) -> bytes:
    """Distribution of position error [mm] and orientation error [deg], as PNG."""
    figure = _figure(8.0, 3.6)
    left, right = figure.subplots(1, 2)
    distances, angles = _errors(report)
    _draw_histogram(left, distances, _BLUE, "position error [mm]")
    _draw_histogram(right, angles, _ORANGE, "orientation error [deg]")
    left.set_ylabel("targets")
    figure.suptitle("Distribution of the tracking error")
    return _png(figure)


def latency_plot(report: TrackingReport) -> bytes:
    """Time from target to command [us] over the time of the recording [s], as PNG."""
    figure = _figure(8.0, 3.6)
    axes = figure.subplots()
    timed = [target for target in report.targets if target.latency_us is not None]
    latencies = [target.latency_us for target in timed if target.latency_us is not None]
    seconds = [(target.stamp_ns - timed[0].stamp_ns) / 1e9 for target in timed]
    if latencies and report.latency_us is not None:
        axes.plot(seconds, latencies, ".", color=_BLUE, markersize=4)
        axes.axhline(
            report.latency_us.p50, color="black", linewidth=1, label="p50", linestyle="--"
        )
        axes.axhline(report.latency_us.p99, color=_GREY, linewidth=1, label="p99", linestyle=":")
        axes.legend(loc="upper right")
        _choose_scale(axes, latencies)
    else:
        _say_empty(axes, "no target was recognised")
    axes.set_title(f"Time from target to command, both as {report.latency_clock}")
    axes.set_xlabel("time since the first target [s]")
    axes.set_ylabel("latency [µs]")
    axes.grid(alpha=0.3)
    return _png(figure)


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), dpi=_DOTS_PER_INCH, layout="constrained")


def _draw_series(
    axes: Axes, numbers: Sequence[int], values: Sequence[float], color: str, label: str
) -> None:
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if not values:
        _say_empty(axes, "no matching pairs")
        return
    marker = "." if len(values) <= _MARKED_TARGETS else ""
    axes.plot(numbers, values, color=color, marker=marker, linewidth=1.0)
    worst = int(np.argmax(values))
    axes.plot(
        numbers[worst],
        values[worst],
        "v",
        color="black",
        label=f"largest: {values[worst]:.3g} (target {numbers[worst]})",
    )
    axes.legend(loc="best")
    _choose_scale(axes, values)


def _draw_histogram(axes: Axes, values: Sequence[float], color: str, label: str) -> None:
    axes.set_xlabel(label)
    if not values:
        _say_empty(axes, "no matching pairs")
        return
    bins: Any = min(_BINS, max(5, len(values) // 4))
    if _spans_decades(values):
        positive = [value for value in values if value > 0]
        bins = np.geomspace(min(positive), max(positive), bins + 1)
        axes.set_xscale("log")
    elif np.ptp(values) <= _SAME * max(values) or max(values) <= _NOTHING:
        # Bins between values that differ only by rounding would have zero width.
        bins = np.linspace(0.0, 2 * max(values) if max(values) > _NOTHING else 1.0, bins + 1)
    axes.hist(values, bins=bins, color=color, edgecolor="white", linewidth=0.5)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    p95 = float(np.percentile(values, 95))
    axes.axvline(p95, color="black", linestyle="--", linewidth=1, label=f"p95: {p95:.3g}")
    axes.legend(loc="best")


def _choose_scale(axes: Axes, values: Sequence[float]) -> None:
    if _spans_decades(values):
        axes.set_yscale("log")
    else:
        axes.set_ylim(bottom=0.0 if max(values) > _NOTHING else None)


def _spans_decades(values: Sequence[float]) -> bool:
    median = float(np.median(values))
    return min(values) > _NOTHING and max(values) > _LOGARITHMIC_RATIO * median


def _set_equal_scales(axes: Axes3D, points: FloatArray) -> None:
    """Give all axes the same scale."""
    centre = (points.max(axis=0) + points.min(axis=0)) / 2
    half = max(float(np.ptp(points, axis=0).max()) / 2, 1e-3) * 1.05
    axes.set(
        xlim=(centre[0] - half, centre[0] + half),
        ylim=(centre[1] - half, centre[1] + half),
        zlim=(centre[2] - half, centre[2] + half),
    )
    axes.set_box_aspect((1, 1, 1), zoom=0.9)
    axes.tick_params(labelsize=8)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(5, prune="both"))


def _say_empty(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes, color=_GREY)


def _errors(report: TrackingReport) -> tuple[list[float], list[float]]:
    """Position errors [mm] and orientation errors [deg]."""
    targets = report.targets
    return [t.position_error_mm for t in targets], [t.orientation_error_deg for t in targets]


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
