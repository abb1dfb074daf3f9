"""Motion in joint space: trapezoidal profiles, and paths inside limits and workspace box."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from annik_core.pose import POSE_FIELDS, FloatArray
from annik_core.robots.robot import Robot
from annik_core.safety import CommandSafety, check_workspace_box


class JointMotion:
    """Straight lines in joint space, with a stop at the end of each.

    On each line all joints start and stop together. The joint that moves furthest has a
    trapezoidal velocity profile, or a triangular one on a short line; the others move in
    proportion, so that no joint exceeds the limits.

    Attributes:
        waypoints: ``(m, dof)`` [rad or m], with the start.
        duration: time from start to stop [s].
    """

    def __init__(
        self, waypoints: FloatArray, max_velocity: float, max_acceleration: float
    ) -> None:
        """Plan the motion; limits of any joint above 0 [rad/s or m/s], [rad/s^2 or m/s^2]."""
        self.waypoints = waypoints
        self._lines = [
            _Line(start, end, max_velocity, max_acceleration)
            for start, end in pairwise(waypoints)
            # Equal waypoints need no line.
            if (start != end).any()
        ]
        self.duration = math.fsum(line.duration for line in self._lines)

    def joint_positions_at(self, time: float) -> FloatArray:
        """Joint positions ``(dof,)`` [rad or m] at ``time`` [s]; outside the motion, its ends."""
        # Rounding of the sum may leave a remainder at the end, so the duration decides.
        if time < self.duration:
            remaining = time
            for line in self._lines:
                if remaining < line.duration:
                    return line.joint_positions_at(max(remaining, 0.0))
                remaining -= line.duration
        last: FloatArray = self.waypoints[-1]
        return last


class _Line:
    def __init__(
        self, start: FloatArray, end: FloatArray, max_velocity: float, max_acceleration: float
    ) -> None:
        self._start = start
        self._end = end
        self._acceleration = max_acceleration
        self._length = float(np.abs(end - start).max(initial=0.0))
        # A short line ends before the velocity limit is reached.
        self._ramp = min(
            max_velocity / max_acceleration, math.sqrt(self._length / max_acceleration)
        )
        self._velocity = max_acceleration * self._ramp
        self.duration = self._length / self._velocity + self._ramp

    def joint_positions_at(self, time: float) -> FloatArray:
        share = self._travelled(time) / self._length
        between = self._start + share * (self._end - self._start)
        # Rounding must not take a joint beyond an end at its limit.
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
    """A path to joint positions, or why there is none.

    ``waypoints`` ``(m, dof)`` [rad or m] lead to the target on straight lines; None if none do.
    ``violation`` is why the direct line is not allowed, or None.
    """

    waypoints: FloatArray | None
    violation: str | None


def place_violation(
    robot: Robot, safety: CommandSafety, joint_positions: FloatArray
) -> str | None:
    """Why joint positions ``(dof,)`` [rad or m] are not allowed, or None."""
    violation = robot.joint_limits.violation(joint_positions)
    if violation is not None or not safety.has_workspace_box:
        return violation
    pose = robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]
    refusal = check_workspace_box(pose, safety)
    return None if refusal is None else refusal.reason


def approach(
    robot: Robot, safety: CommandSafety, start: FloatArray, target: FloatArray, spacing: float
) -> Approach:
    """The straight line to the target; if that is not allowed, through the joint box's centre.

    Continuous joints go the shorter way around: the path may end some full turns from ``target``.
    A joint moves by at most ``spacing`` [rad or m] between two checked points.
    """
    near = robot.unwrapped(target, start)
    violation = _path_violation(robot, safety, start, near, spacing)
    if violation is None:
        return Approach(np.array([start, near]), None)
    centre = robot.unwrapped(robot.joint_box.centre, start)
    end = robot.unwrapped(target, centre)
    for place in (start, end):
        if _path_violation(robot, safety, place, centre, spacing) is not None:
            return Approach(None, violation)
    return Approach(np.array([start, centre, end]), None)


def _path_violation(
    robot: Robot, safety: CommandSafety, start: FloatArray, end: FloatArray, spacing: float
) -> str | None:
    # Joint limits are intervals: between two points inside, everything is inside.
    for place in (end, start):
        violation = place_violation(robot, safety, place)
        if violation is not None:
            return violation
    if not safety.has_workspace_box:
        return None
    steps = max(2, math.ceil(float(np.abs(end - start).max()) / spacing))
    share = np.linspace(0.0, 1.0, steps + 1)[:, np.newaxis]
    positions = robot.forward_kinematics.poses(start + share * (end - start))[:, :3]
    # Between two checked points the path deviates from a line by an eighth of the second
    # difference; twice as much is kept clear.
    margin = 0.25 * np.abs(np.diff(positions, 2, axis=0)).max(axis=0)
    inner = positions[1:-1]
    lower, upper = np.array(safety.workspace_box_lower), np.array(safety.workspace_box_upper)
    outside = (inner < lower + margin) | (inner > upper - margin)
    if not outside.any():
        return None
    row, axis = np.argwhere(outside)[0]
    return (
        f"on the path {POSE_FIELDS[axis]} would be {inner[row, axis]:.6g} m; the workspace box "
        f"allows {lower[axis]:.6g} to {upper[axis]:.6g} m"
    )
