"""Write the report of a bag: HTML, pictures and numbers."""

from __future__ import annotations

import csv
import json
from io import StringIO
from pathlib import Path

from annik_core.files import ensure_writable_folder, write_files_atomically
from msg_tools.bags.reader import read_bag
from msg_tools.report.html import report_html
from msg_tools.report.plots import report_plots
from msg_tools.report.tracking import TrackingReport, tracking_report


def write_report(
    bag_path: Path, output_directory: Path, namespace: str | None = None
) -> TrackingReport:
    """Write report.html, results.json, targets.csv and the pictures of a bag's report.

    An earlier report is replaced only by a complete new one.

    Args:
        bag_path: folder of a bag, or one of its files.
        output_directory: created if it does not exist.
        namespace: of the robot; needed only if the bag holds several.

    Raises:
        BagNotFound: if there is no such bag.
        BagNotReadable: if nothing in it can be read.
        NamespaceError: see :func:`msg_tools.report.namespace.robot_namespace`.
        NotWritable: if the files can't be written; earlier ones are then kept.
    """
    report = tracking_report(read_bag(bag_path), namespace)
    plots = report_plots(report)
    contents = {
        **plots,
        "report.html": report_html(report, plots).encode(),
        "results.json": (json.dumps(report.to_dict(), indent=2, allow_nan=False) + "\n").encode(),
        "targets.csv": _targets_csv(report).encode(),
    }
    ensure_writable_folder(output_directory)
    write_files_atomically(output_directory, contents)
    return report


def _targets_csv(report: TrackingReport) -> str:
    text = StringIO()
    writer = csv.writer(text)
    writer.writerow(
        (
            "target",
            "stamp_ns",
            "x_m",
            "y_m",
            "z_m",
            "position_error_mm",
            "orientation_error_deg",
            "latency_us",
        )
    )
    for target in report.targets:
        writer.writerow(
            (
                target.number,
                target.stamp_ns,
                *target.target,
                target.position_error_mm,
                target.orientation_error_deg,
                target.latency_us,
            )
        )
    return text.getvalue()
