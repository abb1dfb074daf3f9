"""Counts of outcomes, and percentiles of solve times, latencies and expected errors."""

import math
from collections import Counter, deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from annik_core.solver.result import IkResult

#: A rate below this fraction of the expected rate is a warning.
LEAST_RATE = 0.8
#: This many refusals in a period, and nothing accepted, are an error.
MANY = 10


@dataclass(frozen=True)
class OutcomeSummary:
    """Counts since the start, and those of the last period.

    Attributes:
        refused_by_reason: in the order of first occurrence.
        rate: received per second in the last period [Hz]; 0 if it had no duration.
    """

    received: int
    accepted: int
    refused: int
    refused_by_reason: dict[str, int]
    accepted_in_period: int
    refused_in_period: int
    rate: float
    last_refusal: str


class OutcomeCounts:
    """Counts outcomes: each item received is recorded once, as accepted or as refused."""

    def __init__(self, now: float) -> None:
        self._accepted = 0
        self._refused: Counter[str] = Counter()
        self._last_refusal = ""
        self._period_start = now
        self._accepted_before = 0
        self._refused_before = 0

    def record_accepted(self) -> None:
        """Count one that was accepted."""
        self._accepted += 1

    def record_refused(self, reason: str, explanation: str) -> None:
        """Count one that was refused, by a ``reason`` from a short list, explained in one line."""
        self._refused[reason] += 1
        self._last_refusal = explanation

    def end_period(self, now: float) -> OutcomeSummary:
        """Sum up, and begin a new period at ``now`` [s]."""
        refused = sum(self._refused.values())
        received = self._accepted + refused
        duration = now - self._period_start
        summary = OutcomeSummary(
            received=received,
            accepted=self._accepted,
            refused=refused,
            refused_by_reason=dict(self._refused),
            accepted_in_period=self._accepted - self._accepted_before,
            refused_in_period=refused - self._refused_before,
            rate=(received - self._accepted_before - self._refused_before) / duration
            if duration > 0
            else 0.0,
            last_refusal=self._last_refusal,
        )
        self._period_start = now
        self._accepted_before = self._accepted
        self._refused_before = refused
        return summary


#: Number of latest values that the percentiles are computed from.
WINDOW = 1000


class Percentiles(NamedTuple):
    """Percentiles of the latest values; NaN before the first."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class SolveSummary:
    """Counts of the targets, and times of the latest ones.

    Attributes:
        latency: time from the arrival of an accepted target to its command [s].
        expected_error: expected position errors of the latest accepted ones [m]; NaN if unknown.
        solution_requests: how often all solutions were asked for.
        solutions_found: how many that were together.
    """

    outcomes: OutcomeSummary
    solve_time: Percentiles
    latency: Percentiles
    expected_error: Percentiles
    solution_requests: int = 0
    solutions_found: int = 0


class SolveStatistics:
    """Records the results of a solver."""

    def __init__(self, now: float, window: int = WINDOW) -> None:
        self._outcomes = OutcomeCounts(now)
        self._solve_times: deque[float] = deque(maxlen=max(1, window))
        self._latencies: deque[float] = deque(maxlen=max(1, window))
        self._expected_errors: deque[float] = deque(maxlen=max(1, window))
        self._solution_requests = self._solutions_found = 0

    def record(self, result: IkResult, solve_time: float | None = None) -> None:
        """Count one result and its solve time [s], unless it is that of a path."""
        if solve_time is not None:
            self._solve_times.append(solve_time)
        if result.accepted:
            self._outcomes.record_accepted()
            if math.isnan(result.expected_position_error):
                # The model has been replaced by one without an error bound.
                self._expected_errors.clear()
            else:
                self._expected_errors.append(result.expected_position_error)
        else:
            self._outcomes.record_refused(result.status.value, result.reason)

    def record_latency(self, latency: float) -> None:
        """Note the time from the arrival of an accepted target to its command [s]."""
        self._latencies.append(latency)

    def record_solutions(self, found: int) -> None:
        """Count a request for all solutions, and how many were found."""
        self._solution_requests += 1
        self._solutions_found += found

    def begin_period(self, now: float) -> OutcomeSummary:
        """Begin a new period at ``now`` [s]; the counts alone, which takes next to no time."""
        return self._outcomes.end_period(now)

    def end_period(self, now: float) -> SolveSummary:
        """Sum up, and begin a new period at ``now`` [s]."""
        return SolveSummary(
            self.begin_period(now),
            _percentiles(self._solve_times),
            _percentiles(self._latencies),
            _percentiles(self._expected_errors),
            self._solution_requests,
            self._solutions_found,
        )


def _percentiles(values: deque[float]) -> Percentiles:
    if not values:
        return Percentiles(math.nan, math.nan, math.nan)
    return Percentiles(*np.percentile(values, [50, 99, 100]).tolist())
