"""Several recordings of one path in one picture."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from msg_tools.tracking_report import TrackingReport

#: Colours of Okabe and Ito, as in the reports, and lines that differ in grey print too.
_STYLES = (("#E69F00", "-"), ("#0072B2", "--"), ("#009E73", ":"), ("#CC79A7", "-."))


def comparison_plot(reports: Mapping[str, TrackingReport]) -> bytes:
    """Errors of every target, by what each recording is called, as PNG; logarithmic.

    A recording without targets has no line.
    """
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    FigureCanvasAgg(figure)
    upper, lower = figure.subplots(2, 1, sharex=True)
    for (name, report), (colour, line) in zip(reports.items(), _STYLES, strict=False):
        numbers = [target.number for target in report.targets]
        for axes, unit, errors in (
            (upper, "mm", [target.position_error_mm for target in report.targets]),
            (lower, "deg", [target.orientation_error_deg for target in report.targets]),
        ):
            if errors:
                label = f"{name}: mean {np.mean(errors):.3g} {unit}"
                axes.plot(numbers, errors, line, color=colour, label=label)
    for axes, label in ((upper, "position error [mm]"), (lower, "orientation error [deg]")):
        axes.set_yscale("log")
        axes.set_ylabel(label)
        axes.grid(visible=True, which="both", alpha=0.3)
        axes.legend()
    lower.set_xlabel("target")
    content = BytesIO()
    figure.savefig(content, format="png", dpi=110)
    return content.getvalue()
