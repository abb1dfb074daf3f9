"""Paths of target poses ``(n, 7)``: x, y, z [m], unit quaternion x, y, z, w, in the base frame."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray, checked_pose, pose_from_roll_pitch_yaw


class TargetPathError(AnnikError):
    """A path of target poses can't be made as asked."""


#: The paper's test path: P1 to P2 in steps of 20 mm along x, y and z.
DIAGONAL_START = (0.210, 0.210, 0.510)
DIAGONAL_END = (0.490, 0.490, 0.790)
DIAGONAL_END_YAW = math.pi / 2
DIAGONAL_POINTS = 15

#: Columns of a file of targets, in metres and as a unit quaternion.
CSV_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")


class InvalidPathOption(TargetPathError):
    """An option of a path is out of range."""

    def __init__(self, option: str, value: object, allowed: str) -> None:
        self.option = option
        self.value = value
        self.allowed = allowed
        super().__init__(f"{option} is {value!r}; allowed: {allowed}")


class UnreadableTargetFile(TargetPathError):
    """A file of targets is missing, or a line of it is not a target."""

    def __init__(self, path: Path, problem: str, line: int | None = None) -> None:
        self.path = path
        self.problem = problem
        self.line = line
        place = str(path) if line is None else f"{path}, line {line}"
        super().__init__(f"targets {place}: {problem}")


def diagonal_path(points: int = DIAGONAL_POINTS) -> FloatArray:
    """The paper's test path across the workspace of the gantry.

    From P1 (210, 210, 510) mm to P2 (490, 490, 790) mm with roll = pitch = 0 and a yaw that grows
    evenly from 0 to 90 degrees. The paper states 6.44 degrees per step, which would be 90.16
    degrees after its 14 steps, and also 90 degrees at P2, the edge of the workspace. This is
    90 / 14 = 6.4286 degrees per step.

    Args:
        points: how many, ends included; 15 are the paper's, more follow the same path finer.

    Raises:
        InvalidPathOption: if there are fewer than two points.
    """
    share = _shares(points)[:, np.newaxis]
    positions = (1 - share) * np.array(DIAGONAL_START) + share * np.array(DIAGONAL_END)
    return pose_from_roll_pitch_yaw(positions, share * np.array([0.0, 0.0, DIAGONAL_END_YAW]))


def line_path(start: ArrayLike, end: ArrayLike, points: int) -> FloatArray:
    """A straight line, turning about one fixed axis at an even rate, the short way round.

    Args:
        start: pose ``(7,)``.
        end: pose ``(7,)``.
        points: how many, ends included.

    Raises:
        InvalidPathOption: if there are fewer than two points.
        ConversionError: if an end is not a pose.
    """
    share = _shares(points)
    first, last = checked_pose(start), checked_pose(end)
    positions = (1 - share[:, np.newaxis]) * first[:3] + share[:, np.newaxis] * last[:3]
    from scipy.spatial.transform import Rotation, Slerp

    turn = Slerp([0.0, 1.0], Rotation.from_quat(np.stack([first[3:], last[3:]])))
    return np.concatenate([positions, turn(share).as_quat(canonical=True)], axis=1)


def circle_path(
    centre: ArrayLike, radius: float, roll_pitch_yaw: ArrayLike, points: int
) -> FloatArray:
    """A circle in a plane of constant z, anticlockwise seen from above, at one orientation.

    It starts at the greatest x. The first point is not repeated at the end, so that laps join.

    Args:
        centre: ``(3,)`` [m].
        radius: [m], greater than 0.
        roll_pitch_yaw: ``(3,)`` [rad].
        points: how many, spread evenly; at least two.

    Raises:
        InvalidPathOption: if the radius or the number of points is out of range.
    """
    if not (math.isfinite(radius) and radius > 0):
        raise InvalidPathOption("radius", radius, "a number greater than 0 [m]")
    _shares(points)
    angle = 2 * np.pi * np.arange(points) / points
    offset = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(points)], axis=1)
    positions = np.asarray(centre, dtype=np.float64) + offset
    return pose_from_roll_pitch_yaw(positions, np.tile(np.asarray(roll_pitch_yaw), (points, 1)))


def csv_path(path: str | Path) -> FloatArray:
    """The poses of a comma-separated file, one per line after the header.

    The header names at least the columns of :data:`CSV_COLUMNS`, in any order; other columns are
    ignored, and so are empty lines.

    Raises:
        UnreadableTargetFile: naming the line and what is wrong with it, or that there is none.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _poses_from_rows(file, path)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UnreadableTargetFile(path, f"not readable: {error}") from error


def _poses_from_rows(lines: Iterable[str], path: Path) -> FloatArray:
    rows = csv.DictReader(lines, skipinitialspace=True)
    header = [name.strip() for name in rows.fieldnames or []]
    missing = [name for name in CSV_COLUMNS if name not in header]
    if missing:
        raise UnreadableTargetFile(
            path,
            f"the header must name {','.join(CSV_COLUMNS)}; it lacks {', '.join(missing)}",
            line=1,
        )
    rows.fieldnames = header
    poses = []
    for row in rows:
        try:
            poses.append(checked_pose([float(row[name]) for name in CSV_COLUMNS]))
        except (TypeError, ValueError, AnnikError) as error:
            # A short line has None in its last columns, which float() calls a TypeError.
            problem = str(error) if not isinstance(error, TypeError) else "too few columns"
            raise UnreadableTargetFile(path, problem, rows.line_num) from error
    if not poses:
        raise UnreadableTargetFile(path, "there is no target after the header")
    return np.stack(poses)


def _shares(points: int) -> FloatArray:
    """``(points,)`` from 0 to 1, evenly."""
    if points < 2:
        raise InvalidPathOption("points", points, "2 or more")
    return np.linspace(0.0, 1.0, points)
