"""Count what became of everything that was received."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass


@dataclass(frozen=True)
class OutcomeSummary:
    """Counts since the start, and what the last period adds to them.

    Attributes:
        received: ``accepted + refused``, exactly.
        accepted: how many were acted on.
        refused: how many were not.
        refused_by_reason: the refused ones by reason, in the order of first occurrence.
        accepted_in_period: how many were accepted in the last period.
        refused_in_period: how many were refused in the last period.
        rate: received per second in the last period [Hz]; 0 if it had no duration.
        last_refusal: why the latest one was refused, in one line; empty if none was.
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
    """Counts outcomes; every item received is recorded once, as accepted or as refused."""

    def __init__(self, now: float) -> None:
        """Start counting, and the first period, at ``now`` [s] of a clock that never goes back."""
        self._accepted = 0
        self._refused: Counter[str] = Counter()
        self._last_refusal = ""
        self._period_start = now
        self._accepted_before = 0
        self._refused_before = 0

    def record_accepted(self) -> None:
        """Count one that was acted on."""
        self._accepted += 1

    def record_refused(self, reason: str, explanation: str) -> None:
        """Count one that was refused, for a ``reason`` from a short list, explained in a line."""
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
