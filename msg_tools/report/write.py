"""Write the report of a bag: HTML, pictures and numbers."""

import csv
import json
from base64 import b64encode
from collections.abc import Mapping
from io import StringIO
from pathlib import Path
from typing import Final

from annik_core.files import ensure_writable_folder, write_files_atomically
from msg_tools.bags.progress import Progress
from msg_tools.bags.reader import read_bag
from msg_tools.report.plots import report_plots
from msg_tools.report.table import overall_rows, target_rows
from msg_tools.report.templates import rendered
from msg_tools.report.tracking import TrackingReport, tracking_report

#: Rows of the table; targets.csv holds all.
_MAX_ROWS: Final = 1000

_CAPTIONS: Final = {
    "errors.png": "Distance and angle between target and achieved pose, for each target.",
    "path.png": "Target and achieved positions of the end effector, in the base frame.",
    "histogram.png": "Distribution of the errors.",
    "latency.png": "Time from a target's message to its command's.",
}

_CSV_COLUMNS: Final = (
    *("target", "stamp_ns", "x_m", "y_m", "z_m"),
    *("position_error_mm", "orientation_error_deg", "latency_us"),
)


def write_report(
    bag_path: Path,
    output_directory: Path,
    namespace: str | None = None,
    progress: Progress | None = None,
) -> TrackingReport:
    """Write report.html, results.json, targets.csv and the pictures of a bag's report.

    The bag is given by its folder or one of its files, the namespace of the robot only if the bag
    holds several. An earlier report is replaced only by a complete new one.

    Raises:
        BagNotFound: if there is no such bag.
        BagNotReadable: if nothing in it can be read.
        NamespaceError: see :func:`msg_tools.report.namespace.robot_namespace`.
        NotWritable: if the files can't be written; earlier ones are then kept.
    """
    report = tracking_report(read_bag(bag_path, progress), namespace, progress)
    plots = report_plots(report)
    contents = {
        **plots,
        "report.html": _report_html(report, plots).encode(),
        "results.json": (json.dumps(report.to_dict(), indent=2, allow_nan=False) + "\n").encode(),
        "targets.csv": _targets_csv(report).encode(),
    }
    ensure_writable_folder(output_directory)
    write_files_atomically(output_directory, contents)
    return report


def _report_html(report: TrackingReport, plots: Mapping[str, bytes]) -> str:
    """The report as an HTML document; ``plots`` (file name to PNG) are embedded."""
    pictures = [
        (name, _CAPTIONS.get(name, name), b64encode(png).decode()) for name, png in plots.items()
    ]
    return rendered(
        "report.html.jinja",
        report=report,
        overall=overall_rows(report),
        target_rows=target_rows(report.targets[:_MAX_ROWS]),
        row_count=len(report.targets),
        max_rows=_MAX_ROWS,
        pictures=pictures,
    )


def _targets_csv(report: TrackingReport) -> str:
    text = StringIO()
    writer = csv.writer(text)
    writer.writerow(_CSV_COLUMNS)
    for target in report.targets:
        errors = target.position_error_mm, target.orientation_error_deg
        writer.writerow(
            (target.number, target.stamp_ns, *target.target, *errors, target.latency_us)
        )
    return text.getvalue()
