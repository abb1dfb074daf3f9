"""Straight lines in space, each with the joint motion that follows it without a jump.

A line goes from the pose of one random configuration of the joint box to that of another:
positions on the straight segment, orientations turning about one axis at a constant rate. From
the first configuration the solution is followed in small steps of Newton's method on the robot's
own kinematics, without any solver under test. The line is kept if this solution stays in the box
and crosses no singularity: then a jump in a solver's solutions is due to the solver.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot

#: Small steps from one point of a path to the next.
_SUBSTEPS = 4
#: Newton's steps for each of them.
_NEWTON_STEPS = 8
#: Norm of the remaining twist, metres and radians together.
_LEFT = 1e-10
_DAMPING = 1e-12
#: A small step that moves a joint more than this [rad or m] has lost the solution.
_LARGEST_SUBSTEP = 0.1
#: Most lines tried for each that is wanted.
_TRIES = 100


@dataclass(frozen=True, eq=False)
class StraightPath:
    """A line, and a solution that follows it.

    Attributes:
        poses: ``(points, 7)``.
        joint_positions: ``(points, dof)`` in the box, without a jump [rad or m].
    """

    poses: FloatArray
    joint_positions: FloatArray

    @property
    def largest_step(self) -> float:
        """Of any joint from one point to the next [rad or m]."""
        return float(np.abs(np.diff(self.joint_positions, axis=0)).max())


def straight_paths(
    robot: Robot,
    count: int,
    points: int,
    rng: np.random.Generator,
    on_path: Callable[[int], None] = lambda found: None,
    far: float | None = None,
) -> tuple[list[StraightPath], int]:
    """Paths that can be followed without a jump inside the joint box.

    Args:
        robot: an arm.
        count: how many.
        points: on each, ends included.
        rng: what the ends are drawn from.
        on_path: called with the number of paths found.
        far: the joint positions of the ends differ by at most this in each joint [rad or m]; by
            default they are anywhere in the box.

    Returns:
        The paths and how many lines were tried. Fewer than wanted, or none, if
        :data:`_TRIES` times as many tries found no more, as on an arm of five joints.
    """
    paths: list[StraightPath] = []
    tried = 0
    while len(paths) < count and tried < _TRIES * count:
        tried += 1
        first, last = robot.joint_box.sample(2, rng)
        if far is not None:
            last = first + rng.uniform(-far, far, robot.dof)
        ends = robot.forward_kinematics.poses(np.array([first, last]))
        fine = straight_line(ends[0], ends[1], (points - 1) * _SUBSTEPS + 1)
        followed = _followed(robot, fine, first)
        if followed is not None:
            paths.append(StraightPath(fine[::_SUBSTEPS], followed[::_SUBSTEPS]))
            on_path(len(paths))
    return paths, tried


def straight_line(first: FloatArray, last: FloatArray, points: int) -> FloatArray:
    """Poses ``(points, 7)`` on the way from one ``(7,)`` to another, ends included."""
    shares = np.linspace(0.0, 1.0, points)[:, np.newaxis]
    begin = Rotation.from_quat(first[3:])
    turn = (begin.inv() * Rotation.from_quat(last[3:])).as_rotvec()
    orientations = begin * Rotation.from_rotvec(shares * turn)
    positions = first[:3] + shares * (last[:3] - first[:3])
    return np.hstack([positions, orientations.as_quat(canonical=True)])


def _followed(robot: Robot, poses: FloatArray, start: FloatArray) -> FloatArray | None:
    """The solution ``(n, dof)`` along poses that begins at ``start``; None if it is lost."""
    box = robot.joint_box
    free = box.free
    positions = start
    followed = []
    side = 0.0
    for pose in poses:
        found = positions
        for _ in range(_NEWTON_STEPS):
            error = robot.forward_kinematics.linearise(found, pose)
            if error.distance <= _LEFT:
                break
            jacobian = error.jacobian[:, free]
            damped = jacobian @ jacobian.T + _DAMPING * np.eye(6)
            found = found.copy()
            found[free] += jacobian.T @ np.linalg.solve(damped, error.twist)
        else:
            return None
        if np.abs(found - positions).max() > _LARGEST_SUBSTEP:
            return None
        if (found < box.lower).any() or (found > box.upper).any():
            return None
        if len(free) == 6:
            # Singular where the determinant is zero; so its sign tells the sides apart.
            sign = float(np.sign(np.linalg.det(error.jacobian[:, free])))
            if side not in (0.0, sign):
                return None
            side = sign
        positions = found
        followed.append(found)
    return np.array(followed)
