"""The level of a diagnostic report, and the units of its times and errors."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from annik_core.serving.statistics import (
    LEAST_RATE,
    MANY,
    OutcomeSummary,
    Percentiles,
    SolveSummary,
)

pytest.importorskip("rclpy")

from annik_ros.diagnostics import (
    Level,
    OtherCommanders,
    expected_error_values,
    outcome_report,
    time_values,
)


def outcomes(accepted: int = 0, refused: int = 0, rate: float = 0.0) -> OutcomeSummary:
    """Counts of a period, which had others before it."""
    return OutcomeSummary(
        received=100 + accepted + refused,
        accepted=70 + accepted,
        refused=30 + refused,
        refused_by_reason={"not finite": 30 + refused},
        accepted_in_period=accepted,
        refused_in_period=refused,
        rate=rate,
        last_refusal="position.x is nan",
    )


@pytest.mark.parametrize(
    ("period", "expected_rate", "level"),
    [
        (outcomes(accepted=5, rate=5.0), 0.0, Level.OK),
        (outcomes(), 0.0, Level.OK),
        (outcomes(accepted=100, refused=1, rate=101.0), 0.0, Level.WARN),
        (outcomes(refused=MANY - 1, rate=9.0), 0.0, Level.WARN),
        (outcomes(refused=MANY, rate=10.0), 0.0, Level.ERROR),
        (outcomes(accepted=1, refused=MANY, rate=11.0), 0.0, Level.WARN),
        (outcomes(accepted=100, rate=LEAST_RATE * 100.0), 100.0, Level.OK),
        (outcomes(accepted=79, rate=LEAST_RATE * 100.0 - 1.0), 100.0, Level.WARN),
        (outcomes(), 100.0, Level.ERROR),
    ],
)
def test_the_level(period: OutcomeSummary, expected_rate: float, level: Level) -> None:
    report = outcome_report("target", period, "gantry", {}, expected_rate)
    assert report.level is level
    assert ("position.x is nan" in report.message) == (period.refused_in_period > 0)
    assert report.values["targets received"] == str(period.received)
    assert report.values["targets accepted"] == str(period.accepted)
    assert report.values["targets refused"] == str(period.refused)
    assert report.values["refused: not finite"] == str(period.refused)
    assert ("expected target rate [Hz]" in report.values) == (expected_rate > 0.0)


def test_times_are_in_microseconds_and_errors_in_millimetres() -> None:
    summary = SolveSummary(
        outcomes(),
        Percentiles(1e-6, 2e-6, 3e-6),
        Percentiles(4e-6, 5e-6, 6e-6),
        Percentiles(7e-3, 8e-3, 9e-3),
    )
    values = {**time_values(summary), **expected_error_values(summary)}
    assert [float(value) for value in values.values()] == list(range(1, 10))
    assert [key.rpartition(" ")[2] for key in values] == ["[us]"] * 6 + ["[mm]"] * 3


def test_what_is_not_known_is_empty() -> None:
    """Before the first target, and of a model that was not calibrated."""
    unknown = Percentiles(math.nan, math.nan, math.nan)
    summary = SolveSummary(outcomes(), unknown, unknown, unknown)
    values = {**time_values(summary), **expected_error_values(summary)}
    assert set(values.values()) == {""}


class FakeNode:
    """Knows the publishers of a topic, and keeps what is logged."""

    def __init__(self) -> None:
        self.publishers = ["/left/ik_node"]
        self.warnings: list[str] = []
        self.warning = self.warnings.append

    def get_logger(self) -> FakeNode:
        return self

    def get_fully_qualified_name(self) -> str:
        return "/left/ik_node"

    def count_publishers(self, _: str) -> int:
        return len(self.publishers)

    def get_publishers_info_by_topic(self, _: str) -> list[SimpleNamespace]:
        return [
            SimpleNamespace(node_namespace=namespace or "/", node_name=node)
            for namespace, _, node in (name.rpartition("/") for name in self.publishers)
        ]


@pytest.mark.parametrize("other", ["/left/ik_node", "/collector"])
def test_another_commander_is_said_once_also_one_of_the_same_name(other: str) -> None:
    node = FakeNode()
    others = OtherCommanders(node, "/left/joint_command")
    assert others.trouble() == ""
    node.publishers.append(other)
    for _ in range(3):
        assert others.trouble() == f"others publish /left/joint_command too: {other}"
    assert len(node.warnings) == 1
    node.publishers.remove(other)
    assert others.trouble() == ""


def test_trouble_is_a_warning_where_nothing_else_is_wrong() -> None:
    good = outcomes(accepted=3)
    report = outcome_report("target", good, "gantry", {}, trouble="others")
    assert (report.level, report.message) == (Level.WARN, "others")
    bad = outcomes(refused=1)
    assert outcome_report("target", bad, "gantry", {}, trouble="others").message != "others"
