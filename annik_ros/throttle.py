"""Limit how often something happens."""

import math
import time


class Throttle:
    """Allows something once in a period [s]; that of rclpy's logger takes longer than a solve."""

    def __init__(self, period: float = 1.0) -> None:
        self._period = period
        self._next = -math.inf

    def is_due(self) -> bool:
        """Whether a period has passed since the last True."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + self._period
        return True
