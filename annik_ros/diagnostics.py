"""Report on ``/diagnostics`` once a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from annik_core.serving.stamps import LAST_STAMP
from annik_core.serving.statistics import LEAST_RATE, MANY, OutcomeSummary, SolveSummary
from msg_tools.conversions.stamp import stamp_from_nanoseconds
from msg_tools.topics import DIAGNOSTICS

#: Time from one report to the next [s].
DIAGNOSTICS_PERIOD = 1.0


class Level(IntEnum):
    """How serious a report is: the levels of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class DiagnosticReport:
    """The report of a node; ``hardware_id`` is its robot."""

    level: Level
    message: str
    hardware_id: str
    values: Mapping[str, str]


def outcome_report(
    what: str,
    outcomes: OutcomeSummary,
    hardware_id: str,
    values: Mapping[str, str],
    expected_rate: float = 0.0,
) -> DiagnosticReport:
    """The report of a node that accepts or refuses messages; for its level see ``LEVELS``.

    ``what`` names one message, such as ``target``; ``expected_rate`` [Hz] is 0 if unknown.
    """
    level, message = _verdict(what, outcomes, expected_rate)
    counts = {
        f"{what}s received": str(outcomes.received),
        f"{what}s accepted": str(outcomes.accepted),
        f"{what}s refused": str(outcomes.refused),
    }
    reasons = {
        f"refused: {reason}": str(count) for reason, count in outcomes.refused_by_reason.items()
    }
    last = {
        f"{what} rate [Hz]": f"{outcomes.rate:.1f}",
        "last refusal": outcomes.last_refusal,
    }
    expected = {f"expected {what} rate [Hz]": f"{expected_rate:.1f}"} if expected_rate > 0 else {}
    return DiagnosticReport(
        level, message, hardware_id, {**values, **counts, **reasons, **expected, **last}
    )


def _verdict(what: str, outcomes: OutcomeSummary, expected_rate: float) -> tuple[Level, str]:
    if outcomes.refused_in_period > 0:
        none_accepted = outcomes.accepted_in_period == 0
        serious = none_accepted and outcomes.refused_in_period >= MANY
        return (
            Level.ERROR if serious else Level.WARN,
            f"{outcomes.refused_in_period} refused: {outcomes.last_refusal}",
        )
    if outcomes.rate < LEAST_RATE * expected_rate:
        return (
            Level.WARN if outcomes.rate > 0 else Level.ERROR,
            f"{outcomes.rate:.1f} {what}s a second; {expected_rate:.1f} are expected",
        )
    return Level.OK, "OK"


def time_values(summary: SolveSummary) -> dict[str, str]:
    """The times of a summary as diagnostic values; ``nan`` before the first target."""
    return {
        f"{name} {key} [us]": f"{1e6 * value:.1f}"
        for name, times in (("solve time", summary.solve_time), ("latency", summary.latency))
        for key, value in times._asdict().items()
    }


def expected_error_values(summary: SolveSummary) -> dict[str, str]:
    """The expected errors of a summary as diagnostic values; ``nan`` if unknown."""
    return {
        f"expected error {key} [mm]": f"{1e3 * value:.4f}"
        for key, value in summary.expected_error._asdict().items()
    }


def diagnostic_array(report: DiagnosticReport, name: str, stamp: Time) -> DiagnosticArray:
    """The message of a report, under the name of the node."""
    status = DiagnosticStatus(
        level=bytes([report.level]),
        name=name,
        message=report.message,
        hardware_id=report.hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )
    return DiagnosticArray(header=Header(stamp=stamp), status=[status])


class DiagnosticsPublisher:
    """Publishes a report once a second of real time."""

    def __init__(self, node: Node, report: Callable[[], DiagnosticReport]) -> None:
        self._node = node
        self._report = report
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS.name, 10)
        # Simulated time may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(DIAGNOSTICS_PERIOD, self._publish, clock=steady)

    def _publish(self) -> None:
        name = self._node.get_fully_qualified_name().lstrip("/")
        # A simulated time may be too late for a message.
        stamp = stamp_from_nanoseconds(min(self._node.get_clock().now().nanoseconds, LAST_STAMP))
        self._publisher.publish(diagnostic_array(self._report(), name, stamp))
