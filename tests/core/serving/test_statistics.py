"""Counts of outcomes and solve time percentiles. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.safety import IkStatus, Refusal
from annik_core.serving.statistics import OutcomeCounts, SolveStatistics
from annik_core.solver.result import IkResult

REFUSALS = [status for status in IkStatus if status is not IkStatus.SUCCESS]


def _result(status: IkStatus) -> IkResult:
    if status is IkStatus.SUCCESS:
        return IkResult(status, np.zeros(6), 0.0, 0.0, 0, "")
    return IkResult.refused(Refusal(status, f"because of {status.value}"))


def test_nothing_received_yet() -> None:
    """Counts are zero, times are unknown, and there is nothing to warn of."""
    summary = SolveStatistics(0.0).end_period(1.0)
    assert summary.outcomes.received == 0
    assert summary.outcomes.rate == 0.0
    assert summary.outcomes.last_refusal == ""
    assert math.isnan(summary.solve_time.p50)
    assert math.isnan(summary.solve_time.max)


def test_refusals_are_counted_by_reason_and_the_last_one_is_kept() -> None:
    """The reason is the status, the explanation its line."""
    statistics = SolveStatistics(0.0)
    for status in (IkStatus.NOT_FINITE, IkStatus.SUCCESS, IkStatus.WRONG_FRAME):
        statistics.record(_result(status), 1e-3)
    outcomes = statistics.end_period(1.0).outcomes
    assert (outcomes.received, outcomes.accepted, outcomes.refused) == (3, 1, 2)
    assert outcomes.refused_by_reason == {"not finite": 1, "wrong frame": 1}
    assert outcomes.last_refusal == "because of wrong frame"


def test_percentiles_are_of_the_latest_solve_times() -> None:
    """What left the window does not count."""
    statistics = SolveStatistics(0.0, window=4)
    for solve_time in (100.0, 1.0, 2.0, 3.0, 4.0):
        statistics.record(_result(IkStatus.SUCCESS), solve_time)
    summary = statistics.end_period(1.0)
    assert summary.solve_time.p50 == pytest.approx(2.5)
    assert summary.solve_time.max == 4.0
    assert summary.outcomes.received == 5


def test_rate_and_recent_refusals_are_of_the_last_period() -> None:
    """Counts go on, the period starts anew."""
    counts = OutcomeCounts(10.0)
    for _ in range(5):
        counts.record_accepted()
    counts.record_refused("wrong frame", "in frame 'x'")
    first = counts.end_period(12.0)
    assert (first.rate, first.refused_in_period) == (3.0, 1)
    second = counts.end_period(13.0)
    assert (second.rate, second.refused_in_period, second.received) == (0.0, 0, 6)
    assert second.last_refusal == "in frame 'x'"


def test_a_period_without_duration_has_no_rate() -> None:
    """Two reports at the same instant divide by nothing."""
    counts = OutcomeCounts(1.0)
    counts.record_accepted()
    assert counts.end_period(1.0).rate == 0.0


@given(st.lists(st.sampled_from(list(IkStatus)), max_size=60))
def test_received_is_accepted_plus_refused_exactly(statuses: list[IkStatus]) -> None:
    """Every target is counted once, under one outcome."""
    statistics = SolveStatistics(0.0)
    for status in statuses:
        statistics.record(_result(status), 1e-6)
    outcomes = statistics.end_period(1.0).outcomes
    assert outcomes.received == len(statuses) == outcomes.accepted + outcomes.refused
    assert sum(outcomes.refused_by_reason.values()) == outcomes.refused
    assert set(outcomes.refused_by_reason) <= {status.value for status in REFUSALS}


def test_expected_errors_are_of_the_model_that_answers() -> None:
    """After a nominal model was loaded in place of a calibrated one, they are unknown."""
    statistics = SolveStatistics(0.0)
    statistics.record(replace(_result(IkStatus.SUCCESS), expected_position_error=1e-4))
    statistics.record(_result(IkStatus.JOINT_LIMIT))
    assert statistics.end_period(1.0).expected_error.p50 == pytest.approx(1e-4)
    statistics.record(_result(IkStatus.SUCCESS))
    assert math.isnan(statistics.end_period(2.0).expected_error.p50)
