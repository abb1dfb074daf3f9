"""Let something happen at most once in a while."""

from __future__ import annotations

import math
import time


class Throttle:
    """Says when it is time again.

    rclpy's logger has a throttle too, but looks its caller up in the source files before it asks:
    that takes several times as long as to answer a target, and in a flood of bad ones the good
    ones would wait for it.
    """

    def __init__(self, period: float) -> None:
        """``period``: least time from one to the next [s]."""
        self._period = period
        self._next = -math.inf

    def is_due(self) -> bool:
        """Whether it is time; if so, the next is a period away."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + self._period
        return True
