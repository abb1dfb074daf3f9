"""Counts of targets by outcome, and percentiles of the latest solve times."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from annik_core.ik_result import IkResult
from annik_core.outcome_counts import OutcomeCounts, OutcomeSummary

#: How many of the latest solve times the percentiles are taken over.
SOLVE_TIME_WINDOW = 1000


@dataclass(frozen=True)
class SolveSummary:
    """What became of the targets, and how long the latest ones took.

    Attributes:
        outcomes: counts of the targets.
        solve_time_p50: median time to answer a target [s]; NaN before the first.
        solve_time_p99: 99th percentile [s]; NaN likewise.
        solve_time_max: longest [s]; NaN likewise.
    """

    outcomes: OutcomeSummary
    solve_time_p50: float
    solve_time_p99: float
    solve_time_max: float


class SolveStatistics:
    """Records the answers of a solver."""

    def __init__(self, now: float, window: int = SOLVE_TIME_WINDOW) -> None:
        """Start counting at ``now`` [s] of a clock that never goes back.

        Args:
            now: start of the first period [s].
            window: how many of the latest solve times to keep; at least 1.
        """
        self._outcomes = OutcomeCounts(now)
        self._solve_times: deque[float] = deque(maxlen=max(1, window))

    def record(self, result: IkResult, solve_time: float) -> None:
        """Count one answer and the time that it took [s]."""
        self._solve_times.append(solve_time)
        if result.accepted:
            self._outcomes.record_accepted()
        else:
            self._outcomes.record_refused(result.status.value, result.reason)

    def end_period(self, now: float) -> SolveSummary:
        """Sum up, and begin a new period at ``now`` [s]."""
        p50 = p99 = longest = math.nan
        if self._solve_times:
            p50, p99, longest = np.percentile(self._solve_times, [50, 99, 100]).tolist()
        return SolveSummary(self._outcomes.end_period(now), p50, p99, longest)
