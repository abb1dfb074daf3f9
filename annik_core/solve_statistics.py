"""Counts of targets by outcome, and percentiles of the latest times and expected errors."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from annik_core.ik_result import IkResult
from annik_core.outcome_counts import OutcomeCounts, OutcomeSummary

#: How many of the latest times the percentiles are taken over.
WINDOW = 1000


class Percentiles(NamedTuple):
    """Of the latest values; NaN before the first."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class SolveSummary:
    """What became of the targets, and how long the latest ones took.

    Attributes:
        outcomes: counts of the targets.
        solve_time: time to answer a target.
        latency: time from the arrival of an accepted target to its command.
        expected_error: expected position errors of the latest accepted ones [m]; NaN if nobody
            knows.
    """

    outcomes: OutcomeSummary
    solve_time: Percentiles
    latency: Percentiles
    expected_error: Percentiles


class SolveStatistics:
    """Records the answers of a solver."""

    def __init__(self, now: float, window: int = WINDOW) -> None:
        """Start counting at ``now`` [s] of a clock that never goes back.

        Args:
            now: start of the first period [s].
            window: how many of the latest times to keep; at least 1.
        """
        self._outcomes = OutcomeCounts(now)
        self._solve_times: deque[float] = deque(maxlen=max(1, window))
        self._latencies: deque[float] = deque(maxlen=max(1, window))
        self._expected_errors: deque[float] = deque(maxlen=max(1, window))

    def record(self, result: IkResult, solve_time: float | None = None) -> None:
        """Count one answer and the time that it took [s], if that is one target's."""
        if solve_time is not None:
            self._solve_times.append(solve_time)
        if result.accepted:
            self._outcomes.record_accepted()
            if math.isnan(result.expected_position_error):
                # Another model than before, of which nobody knows.
                self._expected_errors.clear()
            else:
                self._expected_errors.append(result.expected_position_error)
        else:
            self._outcomes.record_refused(result.status.value, result.reason)

    def record_latency(self, latency: float) -> None:
        """Note the time from the arrival of an accepted target to its command [s]."""
        self._latencies.append(latency)

    def end_period(self, now: float) -> SolveSummary:
        """Sum up, and begin a new period at ``now`` [s]."""
        return SolveSummary(
            self._outcomes.end_period(now),
            _percentiles(self._solve_times),
            _percentiles(self._latencies),
            _percentiles(self._expected_errors),
        )


def _percentiles(values: deque[float]) -> Percentiles:
    if not values:
        return Percentiles(math.nan, math.nan, math.nan)
    return Percentiles(*np.percentile(values, [50, 99, 100]).tolist())
