"""How to get from one place to another without leaving the joint limits and the workspace box."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from annik_core.command_safety import CommandSafety, box_violation
from annik_core.pose import POSE_FIELDS, FloatArray
from annik_core.robot import Robot


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
    return box_violation(robot.forward_kinematics.poses(joint_positions[np.newaxis])[0], safety)


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
