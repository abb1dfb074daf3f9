"""A motion through joint positions, straight from one to the next, at limited speed."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from annik_core.pose import FloatArray


class JointMotion:
    """Straight lines in joint space, with a stop at the end of each.

    On each line all joints start and stop together. The joint that moves furthest accelerates,
    goes at the limit of velocity if the line is long enough, and slows down (a trapezoid); the
    others move in proportion, so that none exceeds a limit that it holds to.

    Attributes:
        waypoints: ``(m, dof)`` [rad or m], the first one where it starts.
        duration: time from start to stop [s].
    """

    def __init__(
        self, waypoints: FloatArray, max_velocity: float, max_acceleration: float
    ) -> None:
        """Plan it.

        Args:
            waypoints: ``(m, dof)``, at least one [rad or m].
            max_velocity: of any joint, more than 0 [rad/s or m/s].
            max_acceleration: of any joint, more than 0 [rad/s^2 or m/s^2].
        """
        self.waypoints = waypoints
        self._lines = [
            _Line(start, end, max_velocity, max_acceleration)
            for start, end in pairwise(waypoints)
            # From a waypoint to the same there is no way.
            if (start != end).any()
        ]
        self.duration = math.fsum(line.duration for line in self._lines)

    def joint_positions_at(self, time: float) -> FloatArray:
        """Where the joints should be ``time`` [s] after the start: ``(dof,)`` [rad or m].

        Before the start that is the first waypoint, after the end the last one, exactly.
        """
        remaining = time
        for line in self._lines:
            if remaining < line.duration:
                return line.joint_positions_at(max(remaining, 0.0))
            remaining -= line.duration
        last: FloatArray = self.waypoints[-1]
        return last


class _Line:
    """One straight line."""

    def __init__(
        self, start: FloatArray, end: FloatArray, max_velocity: float, max_acceleration: float
    ) -> None:
        self._start = start
        self._end = end
        self._acceleration = max_acceleration
        self._length = float(np.abs(end - start).max(initial=0.0))
        # A short line is over before the limit of velocity is reached.
        self._ramp = min(
            max_velocity / max_acceleration, math.sqrt(self._length / max_acceleration)
        )
        self._velocity = max_acceleration * self._ramp
        self.duration = self._length / self._velocity + self._ramp

    def joint_positions_at(self, time: float) -> FloatArray:
        share = self._travelled(time) / self._length
        between = self._start + share * (self._end - self._start)
        # Rounding must not take a joint beyond an end that lies on its limit.
        positions: FloatArray = np.clip(
            between, np.minimum(self._start, self._end), np.maximum(self._start, self._end)
        )
        return positions

    def _travelled(self, time: float) -> float:
        if time < self._ramp:
            return 0.5 * self._acceleration * time**2
        if time <= self.duration - self._ramp:
            return self._velocity * (time - 0.5 * self._ramp)
        return self._length - 0.5 * self._acceleration * (self.duration - time) ** 2
