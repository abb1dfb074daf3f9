"""Paths inside the joint box of a robot, where the numbers of a path do not suit it."""

from collections.abc import Iterator
from dataclasses import fields, replace

import numpy as np

from annik_core.errors import InvalidValue
from annik_core.pose import FloatArray, roll_pitch_yaw
from annik_core.robots.robot import Robot
from annik_core.safety import CommandSafety, largest_step_beyond
from annik_core.solver.ik_solver import IkSolver
from annik_core.target_paths import PathKind, TargetPath

#: Largest size that is tried [m], and how often it is halved.
_LARGEST_SIZE = 0.2
_HALVINGS = 8
#: Of the way from the start to the upper bounds of the joint box.
_DIAGONAL_SHARE = 0.6
#: How many poses of a path are tried, whatever the number of its points.
_TRIED_POINTS = 51
#: Largest distance of the first solution from the start, and of one solution from the next, of
#: those that are tried [rad or m].
_LARGEST_STEP = CommandSafety().max_first_step


def start_positions(robot: Robot) -> FloatArray:
    """Joint positions ``(dof,)`` [rad or m] near which paths start: a simulated robot is there.

    The centre of the joint box; for the gantry a third of the way to its lower bounds, from where
    a first command may go both to the centre and to the start of the paper's path.
    """
    centre = robot.joint_box.centre
    if robot.kind != "gantry":
        return centre
    start: FloatArray = centre + (robot.joint_box.lower - centre) / 3.0
    return start


def reachable_path(path: TargetPath, solver: IkSolver) -> FloatArray:
    """The targets ``(n, 7)`` of a path, inside the joint box of the solver's robot.

    If the default path of its kind suits the robot, as it does the paper's gantry, numbers that
    were not changed are the defaults. Otherwise they are chosen: a line or a circle starts where
    :func:`start_positions` puts the end effector and is as large as the robot can follow, up to
    0.2 m; the diagonal is straight in joint space.

    Raises:
        AnnikError: if a file can't be used, or no path of this kind can be followed.
    """
    default = TargetPath(path=path.path)
    if path.path is PathKind.CSV or _suits(_poses(default), solver):
        return path.poses()
    if path.path is PathKind.DIAGONAL:
        return _diagonal(path.points, solver)
    given = {
        entry.name: getattr(path, entry.name)
        for entry in fields(path)
        if getattr(path, entry.name) != getattr(default, entry.name)
    }
    for candidate in _candidates(path.path, solver.robot):
        if _suits(_poses(candidate), solver):
            return replace(candidate, **given).poses()
    raise _no_path(path.path, solver)


def _candidates(kind: PathKind, robot: Robot) -> Iterator[TargetPath]:
    """Lines or circles from the start, the largest first."""
    pose = robot.forward_kinematics.poses(start_positions(robot)[np.newaxis])[0]
    start, orientation = pose[:3], roll_pitch_yaw(pose[3:])
    for size in _LARGEST_SIZE * 0.5 ** np.arange(_HALVINGS):
        if kind is PathKind.CIRCLE:
            centre = start - np.array([0.5 * size, 0.0, 0.0])
            yield TargetPath(
                path=kind,
                circle_centre=tuple(centre.tolist()),
                circle_radius=0.5 * float(size),
                circle_roll_pitch_yaw=orientation,
            )
            continue
        for direction in (*np.eye(3), *-np.eye(3)):
            yield TargetPath(
                path=kind,
                line_from_position=tuple(start.tolist()),
                line_from_roll_pitch_yaw=orientation,
                line_to_position=tuple((start + size * direction).tolist()),
                line_to_roll_pitch_yaw=orientation,
            )


def _diagonal(points: int, solver: IkSolver) -> FloatArray:
    """Poses on a straight line in joint space, from the start towards the upper bounds."""
    robot = solver.robot
    start = start_positions(robot)
    for share in _DIAGONAL_SHARE * 0.5 ** np.arange(_HALVINGS):
        end = start + share * (robot.joint_box.upper - start)
        if _suits(robot.forward_kinematics.poses(np.linspace(start, end, _TRIED_POINTS)), solver):
            return robot.forward_kinematics.poses(np.linspace(start, end, points))
    raise _no_path(PathKind.DIAGONAL, solver)


def _poses(path: TargetPath) -> FloatArray:
    return replace(path, points=_TRIED_POINTS).poses()


def _suits(poses: FloatArray, solver: IkSolver) -> bool:
    """Whether every pose is solved, from the start on and without jumps."""
    before = start_positions(solver.robot)
    for pose in poses:
        found = solver.solve(pose, before).joint_positions
        if found is None or largest_step_beyond(_LARGEST_STEP, solver.robot, found, before):
            return False
        before = found
    return True


def _no_path(kind: PathKind, solver: IkSolver) -> InvalidValue:
    allowed = (
        f"diagonal or csv for {solver.robot.name}, which can't keep its orientation along the path"
        if kind is not PathKind.DIAGONAL
        else f"csv for {solver.robot.name}: the model solves no path from the centre of its box"
    )
    return InvalidValue("path", kind.value, allowed)
