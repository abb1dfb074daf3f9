"""Limit how often something happens."""

from __future__ import annotations

import math
import time


class Throttle:
    """Allows something once in a period.

    The throttle of rclpy's logger looks its caller up in the source files each time, which takes
    several times as long as solving a target.
    """

    def __init__(self, period: float) -> None:
        """``period``: least time between two occurrences [s]."""
        self._period = period
        self._next = -math.inf

    def is_due(self) -> bool:
        """Whether a period has passed since the last True."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + self._period
        return True
