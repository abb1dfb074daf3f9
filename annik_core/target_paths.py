"""Paths of target poses ``(n, 7)``: x, y, z [m], unit quaternion x, y, z, w, in the base frame."""

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from annik_core.errors import AnnikError, InvalidValue
from annik_core.files import read_text
from annik_core.pose import FloatArray, checked_pose, pose_from_roll_pitch_yaw
from annik_core.settings import CheckedSettings, setting

#: The paper's test path: P1 to P2 in steps of 20 mm along x, y and z.
DIAGONAL_START = (0.210, 0.210, 0.510)
DIAGONAL_END = (0.490, 0.490, 0.790)
DIAGONAL_END_YAW = math.pi / 2
DIAGONAL_POINTS = 15

#: Columns of a file of targets, in metres and as a unit quaternion.
CSV_COLUMNS = ("x", "y", "z", "qx", "qy", "qz", "qw")
_MOST_BYTES = 16 * 1024 * 1024


class UnreadableTargetFile(AnnikError):
    """A file of targets is missing, or a line of it is not a target."""

    def __init__(self, path: Path, problem: str, line: int | None = None) -> None:
        self.path = path
        self.problem = problem
        self.line = line
        place = str(path) if line is None else f"{path}, line {line}"
        super().__init__(f"targets {place}: {problem}")


def diagonal_path(points: int = DIAGONAL_POINTS) -> FloatArray:
    """The paper's test path across the workspace of the gantry, ends included.

    From P1 (210, 210, 510) mm to P2 (490, 490, 790) mm, with roll = pitch = 0 and yaw from 0 to
    90 degrees in equal steps. (The paper states steps of 6.44 degrees, but also 90 degrees at P2,
    which are 14 steps of 6.4286 degrees.)

    Raises:
        InvalidValue: if there are fewer than two points.
    """
    share = _shares(points)[:, np.newaxis]
    positions = (1 - share) * np.array(DIAGONAL_START) + share * np.array(DIAGONAL_END)
    return pose_from_roll_pitch_yaw(positions, share * np.array([0.0, 0.0, DIAGONAL_END_YAW]))


def line_path(start: ArrayLike, end: ArrayLike, points: int) -> FloatArray:
    """A straight line between poses ``(7,)``, with the shortest rotation, in equal steps.

    Raises:
        InvalidValue: if there are fewer than two points.
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
    """A horizontal circle at constant orientation [rad], anticlockwise seen from above.

    It starts at the largest x. The first point is not repeated at the end, so laps can be joined.

    Raises:
        InvalidValue: if the radius or the number of points is out of range.
    """
    if not (math.isfinite(radius) and radius > 0):
        raise InvalidValue("radius", radius, "a finite number greater than 0 [m]")
    _shares(points)
    angle = 2 * np.pi * np.arange(points) / points
    offset = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(points)], axis=1)
    positions = np.asarray(centre, dtype=np.float64) + offset
    return pose_from_roll_pitch_yaw(positions, np.tile(np.asarray(roll_pitch_yaw), (points, 1)))


def csv_path(path: str | Path) -> FloatArray:
    """The poses of a comma-separated file, one per line after the header.

    The header names the columns of :data:`CSV_COLUMNS` in any order; other columns and empty
    lines are ignored.

    Raises:
        UnreadableTargetFile: naming the line and what is wrong with it.
    """
    path = Path(path)
    try:
        text = read_text(path, _MOST_BYTES)
        return _poses_from_rows(StringIO(text, newline=""), path)
    # ValueError: not UTF-8, or a path that no file could have.
    except (OSError, ValueError, csv.Error) as error:
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
            # Missing columns of a short line are None, which float() refuses with a TypeError.
            problem = str(error) if not isinstance(error, TypeError) else "too few columns"
            raise UnreadableTargetFile(path, problem, rows.line_num) from error
    if not poses:
        raise UnreadableTargetFile(path, "no target after the header")
    return np.stack(poses)


def _shares(points: int) -> FloatArray:
    """``(points,)`` numbers from 0 to 1, equally spaced."""
    if points < 2:
        raise InvalidValue("points", points, "an integer of at least 2")
    return np.linspace(0.0, 1.0, points)


class PathKind(Enum):
    """The paths that can be made."""

    DIAGONAL = "diagonal"
    LINE = "line"
    CIRCLE = "circle"
    CSV = "csv"


@dataclass(frozen=True)
class TargetPath(CheckedSettings):
    """A path by its settings; those of other kinds of paths are ignored."""

    path: PathKind = setting(PathKind.DIAGONAL, "The path. diagonal: the paper's test path.")
    points: int = setting(
        DIAGONAL_POINTS, "How many targets the path has; csv: ignored.", within=(2, 10_000_000)
    )
    csv_file: str = setting(
        "", "For csv: file with the header x,y,z,qx,qy,qz,qw [m, unit quaternion]."
    )
    line_from_position: tuple[float, ...] = setting(
        (0.25, 0.25, 0.55), "For line: first position x, y, z.", unit="m"
    )
    line_from_roll_pitch_yaw: tuple[float, ...] = setting(
        (0.5, 0.5, 0.5), "For line: first orientation, about the fixed x, y, z axes.", unit="rad"
    )
    line_to_position: tuple[float, ...] = setting(
        (0.45, 0.45, 0.75), "For line: last position x, y, z.", unit="m"
    )
    line_to_roll_pitch_yaw: tuple[float, ...] = setting(
        (0.5, 0.5, 0.5), "For line: last orientation, about the fixed x, y, z axes.", unit="rad"
    )
    circle_centre: tuple[float, ...] = setting(
        (0.3, 0.35, 0.65), "For circle: centre x, y, z.", unit="m"
    )
    circle_radius: float = setting(
        0.08, "For circle: radius, in the plane of constant z.", unit="m", within=(1e-6, 1000.0)
    )
    circle_roll_pitch_yaw: tuple[float, ...] = setting(
        (0.5, 0.5, 0.5), "For circle: orientation, about the fixed x, y, z axes.", unit="rad"
    )

    def poses(self) -> FloatArray:
        """The targets ``(n, 7)``; raise AnnikError if the file can't be used."""
        if self.path is PathKind.LINE:
            start = pose_from_roll_pitch_yaw(
                self.line_from_position, self.line_from_roll_pitch_yaw
            )
            end = pose_from_roll_pitch_yaw(self.line_to_position, self.line_to_roll_pitch_yaw)
            return line_path(start, end, self.points)
        if self.path is PathKind.CIRCLE:
            return circle_path(
                self.circle_centre, self.circle_radius, self.circle_roll_pitch_yaw, self.points
            )
        if self.path is PathKind.CSV:
            if not self.csv_file:
                raise InvalidValue("csv_file", "", "the path of a file, if path is csv")
            return csv_path(self.csv_file)
        return diagonal_path(self.points)
