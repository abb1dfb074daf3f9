"""The interactive page of a report: one HTML file that needs no network and no server."""

import gzip
from base64 import b64encode
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from plotly.offline import get_plotlyjs

from msg_tools.report.table import overall_rows
from msg_tools.report.templates import rendered
from msg_tools.report.tracking import TargetResult, TrackingReport

#: At most so many targets are drawn: a browser stays quick, and the page small.
MAX_DRAWN: Final = 5000
#: The largest errors are magnified to at most this part of the size of the path.
_LARGEST_PART: Final = 0.2
_LARGEST_MAGNIFICATION: Final = 10_000_000


def interactive_page(report: TrackingReport) -> str:
    """The report as one HTML document with plots to zoom; their library is in it."""
    packed = gzip.compress(get_plotlyjs().encode(), mtime=0)
    return rendered(
        "interactive.html.jinja",
        report=report,
        overall=overall_rows(report),
        page=page_data(report),
        plotly=b64encode(packed).decode(),
    )


def page_data(report: TrackingReport) -> dict[str, Any]:
    """What the page draws, as JSON values.

    ``targets`` and ``refusals`` are columns; ``seconds`` [s] count from the first target.
    """
    drawn = drawn_targets(report.targets)
    # Every so many from the last on, which has the counts of the report.
    refusals = report.refusals[:: -(1 + len(report.refusals) // MAX_DRAWN)][::-1]
    start = min(
        [target.stamp_ns for target in report.targets[:1]] or [at.stamp_ns for at in refusals[:1]],
        default=0,
    )
    positions = {
        prefix + axis: [point[number] for point in points]
        for prefix, points in (
            ("", [target.target for target in drawn]),
            ("achieved_", [target.achieved for target in drawn]),
        )
        for number, axis in enumerate("xyz")
    }
    return {
        "targets": {
            "number": [target.number for target in drawn],
            "seconds": [(target.stamp_ns - start) / 1e9 for target in drawn],
            **positions,
            "position_error_mm": [target.position_error_mm for target in drawn],
            "orientation_error_deg": [target.orientation_error_deg for target in drawn],
            "latency_us": [target.latency_us for target in drawn],
        },
        "refusals": {
            "seconds": [(at.stamp_ns - start) / 1e9 for at in refusals],
            "counts": {
                reason: [at.reasons.get(reason, 0) for at in refusals]
                for reason in report.refusal_reasons
            },
        },
        "run_length": _run_length(len(report.targets)),
        "magnification": _magnification(report.targets),
    }


def drawn_targets(targets: Sequence[TargetResult]) -> list[TargetResult]:
    """At most :data:`MAX_DRAWN` targets in their order, with the extremes of every run."""
    if len(targets) <= MAX_DRAWN:
        return list(targets)
    length = _run_length(len(targets))
    kept = []
    for first in range(0, len(targets), length):
        run = range(first, min(first + length, len(targets)))
        kept += sorted(
            {
                first,
                max(run, key=lambda i: targets[i].position_error_mm),
                max(run, key=lambda i: targets[i].orientation_error_deg),
                max(run, key=lambda i: targets[i].latency_us or 0.0),
            }
        )
    return [targets[index] for index in kept]


def _run_length(count: int) -> int:
    """How many targets in a row are drawn as up to four; 1 if all are drawn."""
    return 1 if count <= MAX_DRAWN else -(-count // (MAX_DRAWN // 4))


def _magnification(targets: Sequence[TargetResult]) -> int:
    """The power of ten by which errors are magnified at first."""
    if not targets:
        return 1
    size = float(np.ptp([target.target for target in targets], axis=0).max())
    largest = max(target.position_error_mm for target in targets) * 1e-3
    power = 1
    while power < _LARGEST_MAGNIFICATION and 10 * power * largest <= _LARGEST_PART * size:
        power *= 10
    return power
