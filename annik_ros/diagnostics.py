"""Report on ``/diagnostics`` once a second."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Header

from annik_core.errors import listed
from annik_core.serving.statistics import LEAST_RATE, MANY, OutcomeSummary, SolveSummary
from msg_tools.conversions.stamp import nearest_stamp
from msg_tools.topics import DIAGNOSTICS

#: Time from one report to the next [s].
DIAGNOSTICS_PERIOD = 1.0
#: The value of ``example_collector`` by which ``viewer`` follows it.
ROWS_MEASURED = "rows measured"


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
    trouble: str = "",
) -> DiagnosticReport:
    """The report of a node that accepts or refuses messages; for its level see ``LEVELS``.

    ``what`` names one message, such as ``target``; ``expected_rate`` [Hz] is 0 if unknown.
    ``trouble`` is a warning where there is no other.
    """
    level, message = _verdict(what, outcomes, expected_rate)
    if trouble and level is Level.OK:
        level, message = Level.WARN, trouble
    counts = {
        f"{what}s received": str(outcomes.received),
        f"{what}s accepted": str(outcomes.accepted),
        f"{what}s refused": str(outcomes.refused),
    }
    reasons = {
        f"refused: {reason}": str(count) for reason, count in outcomes.refused_by_reason.items()
    }
    last = {f"{what} rate [Hz]": f"{outcomes.rate:.1f}", "last refusal": outcomes.last_refusal}
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
    """The times of a summary as diagnostic values; empty before the first target."""
    return {
        f"{name} {key} [us]": _known(1e6 * value, 1)
        for name, times in (("solve time", summary.solve_time), ("latency", summary.latency))
        for key, value in times._asdict().items()
    }


def expected_error_values(summary: SolveSummary) -> dict[str, str]:
    """The expected errors of a summary as diagnostic values; empty if unknown."""
    return {
        f"expected error {key} [mm]": _known(1e3 * value, 4)
        for key, value in summary.expected_error._asdict().items()
    }


def _known(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


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


class OtherCommanders:
    """Warns of other nodes that publish a topic of commands, whenever there are more of them."""

    def __init__(self, node: Node, topic: str) -> None:
        """Look for others on the resolved name of a topic."""
        self._node = node
        self._topic = topic
        self._known = 0

    def trouble(self) -> str:
        """Who they are, in words; empty if this node is the only one."""
        # Counting takes a tenth of the time of asking who they are.
        if self._node.count_publishers(self._topic) <= 1:
            self._known = 0
            return ""
        names = [
            f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
            for publisher in self._node.get_publishers_info_by_topic(self._topic)
        ]
        own = self._node.get_fully_qualified_name()
        # Once: another node may have the same name.
        if own in names:
            names.remove(own)
        trouble = f"others publish {self._topic} too: {listed(names)}" if names else ""
        if len(names) > self._known:
            self._node.get_logger().warning(
                f"{trouble}; end them, or the robot gets two commands at a time"
            )
        self._known = len(names)
        return trouble


class DiagnosticsPublisher:
    """Publishes a report once a second of real time, if anyone listens."""

    def __init__(
        self,
        node: Node,
        report: Callable[[], DiagnosticReport],
        unheard: Callable[[], object] | None = None,
    ) -> None:
        """``unheard`` is called instead of ``report`` where nobody listens, being quicker."""
        self._node = node
        self._report = report
        self._unheard = unheard or report
        self._publisher = node.create_publisher(DiagnosticArray, DIAGNOSTICS.name, 10)
        # Simulated time may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(DIAGNOSTICS_PERIOD, self._publish, clock=steady)

    def _publish(self) -> None:
        if not self._publisher.get_subscription_count():
            self._unheard()
            return
        name = self._node.get_fully_qualified_name().lstrip("/")
        stamp = nearest_stamp(self._node.get_clock().now().nanoseconds)
        self._publisher.publish(diagnostic_array(self._report(), name, stamp))
