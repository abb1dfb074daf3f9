"""The report as tables in a terminal."""

from collections.abc import Iterable
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table

from msg_tools.report.tracking import TargetResult, TrackingReport

#: With more targets than this, only the worst are shown.
_MAX_ROWS: Final = 30
_SHOWN_WORST: Final = 10


def print_report(report: TrackingReport, console: Console | None = None) -> None:
    """Print the report's notes and tables."""
    (console or Console()).print(report_tables(report))


def report_tables(report: TrackingReport) -> RenderableType:
    """The report's notes and tables, for rich to render."""
    first = [f"[red]![/red] {escape(report.why_refused)}"] if report.why_refused else []
    notes = [f"[yellow]![/yellow] {escape(note)}" for note in report.notes]
    parts: list[RenderableType] = [*first, *notes, _counts_table(report)]
    if report.targets:
        parts += [_overall_table(report), _targets_table(report)]
    return Group(*parts)


def overall_rows(report: TrackingReport) -> list[tuple[str, ...]]:
    """Name with unit, p50, p95, p99 and maximum of each quantity that is known."""
    quantities = (
        ("position error [mm]", report.position_error_mm, ".4f"),
        ("orientation error [deg]", report.orientation_error_deg, ".5f"),
        ("latency [µs]", report.latency_us, ".0f"),
    )
    return [
        (name, *(format(value, form) for value in summary))
        for name, summary, form in quantities
        if summary is not None
    ]


def target_rows(targets: Iterable[TargetResult]) -> list[tuple[str, ...]]:
    """Number, x, y, z [m], position error [mm], orientation error [deg], latency [us]."""
    return [
        (
            str(target.number),
            *(f"{coordinate:.4f}" for coordinate in target.target),
            f"{target.position_error_mm:.4f}",
            f"{target.orientation_error_deg:.5f}",
            "" if target.latency_us is None else f"{target.latency_us:.0f}",
        )
        for target in targets
    ]


def _counts_table(report: TrackingReport) -> Table:
    table = Table(title="Targets")
    for heading in ("sent", "answered", "unanswered", "refused"):
        table.add_column(heading, justify="right")
    table.add_column("reasons")
    reasons = ", ".join(f"{reason}: {count}" for reason, count in report.refusal_reasons.items())
    table.add_row(
        str(report.targets_sent),
        str(report.targets_answered),
        str(report.targets_unanswered),
        str(report.targets_refused),
        escape(reasons),
    )
    return table


def _overall_table(report: TrackingReport) -> Table:
    table = Table(title="Target minus achieved, and time to the command")
    table.add_column("")
    for heading in ("p50", "p95", "p99", "max"):
        table.add_column(heading, justify="right")
    for row in overall_rows(report):
        table.add_row(escape(row[0]), *row[1:])
    return table


def _targets_table(report: TrackingReport) -> Table:
    shown: Iterable[TargetResult] = report.targets
    title = "Each target"
    if len(report.targets) > _MAX_ROWS:
        worst = sorted(report.targets, key=lambda target: -target.position_error_mm)
        shown = worst[:_SHOWN_WORST]
        title = f"The {_SHOWN_WORST} largest position errors of {len(report.targets)} targets"
    table = Table(title=title)
    for heading in ("target", "x [m]", "y [m]", "z [m]", "position [mm]", "angle [deg]", "[µs]"):
        table.add_column(escape(heading), justify="right")
    for row in target_rows(shown):
        table.add_row(*row)
    return table
