"""Report on ``/diagnostics`` once a second."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from annik_core.outcome_counts import OutcomeSummary
from annik_core.solve_statistics import SolveSummary
from msg_tools.topics import DIAGNOSTICS

#: Time between two reports [s].
DIAGNOSTICS_PERIOD = 1.0


@dataclass(frozen=True)
class DiagnosticReport:
    """What a node says of itself.

    Attributes:
        warning: whether a person should look.
        message: one line.
        hardware_id: the robot that it is about.
        values: everything else, as text by name.
    """

    warning: bool
    message: str
    hardware_id: str
    values: Mapping[str, str]


def outcome_report(
    what: str, outcomes: OutcomeSummary, hardware_id: str, values: Mapping[str, str]
) -> DiagnosticReport:
    """The report of a node that accepts or refuses what it receives.

    Args:
        what: what is received, in the singular, such as ``target``.
        outcomes: what became of it; the report warns if the last period had a refusal.
        hardware_id: the robot.
        values: what else to report, before the counts.
    """
    warning = outcomes.refused_in_period > 0
    message = f"{outcomes.refused_in_period} refused: {outcomes.last_refusal}" if warning else "OK"
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
    return DiagnosticReport(warning, message, hardware_id, {**values, **counts, **reasons, **last})


def solve_time_values(summary: SolveSummary) -> dict[str, str]:
    """The solve times of a summary as diagnostic values; ``nan`` before the first target."""
    return {
        "solve time p50 [us]": f"{1e6 * summary.solve_time_p50:.1f}",
        "solve time p99 [us]": f"{1e6 * summary.solve_time_p99:.1f}",
        "solve time max [us]": f"{1e6 * summary.solve_time_max:.1f}",
    }


def diagnostic_array(report: DiagnosticReport, name: str, stamp: Time) -> DiagnosticArray:
    """The message of a report, under the name of its source."""
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if report.warning else DiagnosticStatus.OK,
        name=name,
        message=report.message,
        hardware_id=report.hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )
    return DiagnosticArray(header=Header(stamp=stamp), status=[status])


class DiagnosticsPublisher:
    """Asks for a report once a second of real time, and publishes it."""

    def __init__(self, node: Node, report: Callable[[], DiagnosticReport]) -> None:
        """Publish what ``report`` returns, under the full name of ``node``."""
        self._node = node
        self._report = report
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS.name, 10)
        # Simulated time may stand still; the report must not.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(DIAGNOSTICS_PERIOD, self._publish, clock=steady)

    def _publish(self) -> None:
        name = self._node.get_fully_qualified_name().lstrip("/")
        stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(diagnostic_array(self._report(), name, stamp))
