"""Stamps that name one command each, whatever the clock does."""

from __future__ import annotations

#: The last time that a ROS stamp can hold; it has 31 bits of seconds [ns].
LAST_STAMP = 2**31 * 1_000_000_000 - 1


class UniqueStamps:
    """Gives out strictly increasing stamps that follow a clock.

    Target, command and result are paired by their stamp, so two commands must never share one:
    not when the clock is coarse, and not when it is set back, as simulated time is on a restart.
    """

    def __init__(self) -> None:
        """Start with no stamp given out."""
        self._last: int | None = None

    def next(self, now: int) -> int:
        """``now`` [ns], or one nanosecond after the last stamp if that is later.

        After the last stamp that a message can hold they begin again with the clock: a clock that
        once showed nonsense, such as a time later than that, must not end all commands.
        """
        now = min(now, LAST_STAMP)
        if self._last is not None and now <= self._last < LAST_STAMP:
            now = self._last + 1
        self._last = now
        return now
