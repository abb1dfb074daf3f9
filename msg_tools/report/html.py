"""The report as one self-contained HTML file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from importlib.resources import files
from typing import Final

from jinja2 import Environment, StrictUndefined

from msg_tools.report.table import overall_rows, target_rows
from msg_tools.report.tracking import TrackingReport

#: Rows of the table; targets.csv holds all.
_MAX_ROWS: Final = 1000

_CAPTIONS: Final = {
    "errors.png": "Distance and angle between target and achieved pose, for each target.",
    "path.png": "Target and achieved positions of the end effector, in the base frame.",
    "histogram.png": "Distribution of the errors.",
    "latency.png": "Time from a target's message to its command's.",
}


def report_html(report: TrackingReport, plots: Mapping[str, bytes]) -> str:
    """The report as an HTML document.

    Args:
        report: the numbers.
        plots: file name to PNG; embedded.
    """
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = files("msg_tools.report").joinpath("report.html.jinja").read_text(encoding="utf-8")
    pictures = [
        (name, _CAPTIONS.get(name, name), b64encode(png).decode()) for name, png in plots.items()
    ]
    return environment.from_string(template).render(
        report=report,
        overall=overall_rows(report),
        target_rows=target_rows(report.targets[:_MAX_ROWS]),
        row_count=len(report.targets),
        max_rows=_MAX_ROWS,
        pictures=pictures,
    )
