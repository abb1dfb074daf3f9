"""Which example is next, and what became of those that failed."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from annik_core.errors import CollectionStopped


class ExampleQueue:
    """Rows of a plan in their order; those that failed once more after all others.

    Attributes:
        missing: rows that failed, with the last reason; they may be in the queue still.
        skipped: rows that the robot is not allowed to go to, with the reason; likewise.
        failures: how often an attempt has failed.
    """

    def __init__(self, rows: Sequence[int], max_retries: int, max_failures_in_a_row: int) -> None:
        """Queue up rows; see :class:`annik_core.collection_settings.CollectionSettings`."""
        self.missing: dict[int, str] = {}
        self.skipped: dict[int, str] = {}
        self.failures = 0
        self._now = deque(rows)
        self._later: list[int] = []
        self._retries_left = max_retries
        self._first_round = True
        self._in_a_row = 0
        self._max_in_a_row = max_failures_in_a_row

    def next_row(self) -> int | None:
        """Take the next row out; None if there is none."""
        if not self._now and self._later and self._retries_left > 0:
            self._now.extend(self._later)
            self._later.clear()
            self._retries_left -= 1
            self._first_round = False
        return self._now.popleft() if self._now else None

    def record_done(self, row: int) -> None:
        """A row that was taken out is measured."""
        self.missing.pop(row, None)
        self.skipped.pop(row, None)
        self._in_a_row = 0

    def record_failed(self, row: int, reason: str) -> None:
        """A row that was taken out could not be measured this time.

        Raises:
            CollectionStopped: if it is the last of too many in a row. What is in the queue for a
                second time failed before, so then that says nothing new.
        """
        self.failures += 1
        self.skipped.pop(row, None)
        self.missing[row] = reason
        self._later.append(row)
        self._in_a_row += 1
        if self._first_round and self._in_a_row >= self._max_in_a_row:
            raise CollectionStopped(
                f"{self._in_a_row} examples failed in a row, the last because {reason}"
            )

    def record_skipped(self, row: int, reason: str, *, for_good: bool) -> None:
        """A row that was taken out can't be gone to: from anywhere, or from here."""
        self.missing.pop(row, None)
        self.skipped[row] = reason
        if not for_good:
            self._later.append(row)
