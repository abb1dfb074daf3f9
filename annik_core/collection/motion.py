"""Motion from one configuration to the next: trapezoidal profile, approach from one side.

A motion through joint positions, straight from one to the next, at limited speed.

How to get from one place to another without leaving the joint limits and the workspace box.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from annik_core.pose import POSE_FIELDS, FloatArray
from annik_core.robots.robot import Robot
from annik_core.safety import CommandSafety, check_workspace_box


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
        # The parts of a sum that was rounded may leave a remainder at the end.
        remaining = time if time < self.duration else math.inf
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


class Approach(NamedTuple):
    """A way to joint positions, or why there is none.

    Attributes:
        waypoints: ``(m, dof)`` from the start to the target, straight from one to the next [rad
            or m]; None if there is no allowed way.
        violation: what the direct way runs into, or None.
    """

    waypoints: FloatArray | None
    violation: str | None


def place_violation(
    robot: Robot, safety: CommandSafety, joint_positions: FloatArray
) -> str | None:
    """Why the robot must not be at joint positions ``(dof,)`` [rad or m], or None."""
    violation = robot.joint_limits.violation(joint_positions)
    if violation is not None or not safety.has_workspace_box:
        return violation
    pose = robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]
    refusal = check_workspace_box(pose, safety)
    return None if refusal is None else refusal.reason


def approach(
    robot: Robot, safety: CommandSafety, start: FloatArray, target: FloatArray, spacing: float
) -> Approach:
    """The straight way to the target; if that is not allowed, by way of the joint box's centre.

    Args:
        robot: knows the joint limits, and where the end effector is.
        safety: has the workspace box.
        start: ``(dof,)`` [rad or m].
        target: ``(dof,)`` [rad or m].
        spacing: the way is looked at in steps in which no joint moves further [rad or m].
    """
    violation = _way_violation(robot, safety, start, target, spacing)
    if violation is None:
        return Approach(np.array([start, target]), None)
    centre = robot.joint_box.centre
    for end in (start, target):
        if _way_violation(robot, safety, end, centre, spacing) is not None:
            return Approach(None, violation)
    return Approach(np.array([start, centre, target]), None)


def _way_violation(
    robot: Robot, safety: CommandSafety, start: FloatArray, end: FloatArray, spacing: float
) -> str | None:
    # The limits are intervals: what lies between two points that are inside is inside.
    for place in (end, start):
        violation = place_violation(robot, safety, place)
        if violation is not None:
            return violation
    if not safety.has_workspace_box:
        return None
    steps = max(2, math.ceil(float(np.abs(end - start).max()) / spacing))
    share = np.linspace(0.0, 1.0, steps + 1)[:, np.newaxis]
    positions = robot.forward_kinematics.poses(start + share * (end - start))[:, :3]
    # Between two points that are looked at the way bends by an eighth of the second difference;
    # a quarter is kept clear.
    margin = 0.25 * np.abs(np.diff(positions, 2, axis=0)).max(axis=0)
    inner = positions[1:-1]
    lower, upper = np.array(safety.workspace_box_lower), np.array(safety.workspace_box_upper)
    outside = (inner < lower + margin) | (inner > upper - margin)
    if not outside.any():
        return None
    row, axis = np.argwhere(outside)[0]
    return (
        f"on the way {POSE_FIELDS[axis]} would be {inner[row, axis]:.6g} m; the workspace box "
        f"allows {lower[axis]:.6g} to {upper[axis]:.6g} m"
    )
