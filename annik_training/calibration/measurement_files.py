"""Measurements from files: tables with named columns, and joint positions with a ball in sockets.

A table is comma-, semicolon-, tab- or space-separated. Its first line names the columns, in any
order: every joint of the robot; ``x, y, z`` with or without ``qx, qy, qz, qw`` or a rotation
vector ``rx, ry, rz``; or, instead of these, ``socket``, the number of the socket that the ball is
in, and ``placement``, which tells the places of the base with the sockets apart. A name may have a
unit: ``x_mm``, ``elbow [deg]``. Other columns are not used.
"""

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.errors import InvalidValue
from annik_core.files import expanded, read_text
from annik_core.pose import FloatArray
from annik_core.robots.definition import ANGLE_UNITS, LENGTH_UNITS
from annik_core.robots.robot import Robot
from annik_training.calibration.errors import UnlikelyUnits, UnreadableMeasurements
from annik_training.calibration.measurements import KnownDistance, Measurements

POSITION = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
ROTATION_VECTOR = ("rx", "ry", "rz")
SOCKET, PLACEMENT = "socket", "placement"
_MOST_BYTES = 64 * 1024 * 1024
#: A name of a column with its unit: x_mm, x [mm], x(mm), x mm.
_WITH_UNIT = re.compile(r"(?P<name>.+?)[ _]*[ _\[(](?P<unit>[a-z°]+)[\])]?")
#: File of the joint positions with the ball in one socket: hole_0.csv.
_SOCKET_FILE = re.compile(r"(hole|socket)_?(?P<number>\d+)\.(csv|txt)", re.IGNORECASE)
#: A quaternion whose norm is further from 1 is none; some files have few digits.
_NORM_TOLERANCE = 0.01
#: Descriptions have limits that the robot itself exceeds; by this factor they are of another unit.
_FAR = 2.0
#: Turns of a continuous joint [rad] that count as its limit.
_MOST_TURNS = 4.0 * math.pi
#: Positions are spread further than the arm reaches by this factor, or less than it moves by its
#: inverse, only if their unit is another one.
_SCALE = 5.0
#: An arm that moves less than this part of its reach tells nothing about the unit.
_MOVED = 0.05


class Units(NamedTuple):
    """Units of the columns that name none."""

    length: str = "m"
    angle: str = "rad"


@dataclass(frozen=True, eq=False)
class MeasuredRows:
    """Rows of one file or several, in [m] and [rad]."""

    joint_positions: FloatArray  #: ``(n, dof)`` in the order of the robot's joints
    positions: FloatArray | None  #: ``(n, 3)`` in the instrument's frame
    rotations: FloatArray | None  #: ``(n, 3, 3)`` in the instrument's frame
    #: ``(n,)`` placement and socket of each row; None without sockets.
    sockets: tuple[tuple[str, int], ...] | None
    places: tuple[tuple[Path, int], ...]  #: ``(n,)`` file and line of each row
    notes: tuple[str, ...] = ()  #: what was not used

    def __len__(self) -> int:
        return len(self.joint_positions)

    def measurements(
        self,
        *,
        socket_distance: float | None = None,
        frame_known: bool = False,
        tool_known: bool = False,
    ) -> Measurements:
        """These rows for a calibration; each socket of each placement is a fixed point.

        ``socket_distance`` is that between the two sockets of every placement [m]; where only one
        was touched, it tells nothing.

        Raises:
            InvalidValue: if it is given, and a placement has more sockets, or none has two.
        """
        if self.sockets is None:
            if socket_distance is not None:
                raise InvalidValue("socket distance", socket_distance, "none without sockets")
            return Measurements(
                self.joint_positions,
                self.positions,
                self.rotations,
                frame_known=frame_known,
                tool_known=tool_known,
            )
        points = {socket: number for number, socket in enumerate(dict.fromkeys(self.sockets))}
        numbers = np.array([points[socket] for socket in self.sockets])
        distances = []
        if socket_distance is not None:
            for placement in dict.fromkeys(placement for placement, _ in points):
                pair = [number for (other, _), number in points.items() if other == placement]
                if len(pair) == 2:
                    distances.append(KnownDistance(pair[0], pair[1], socket_distance))
                elif len(pair) > 2:
                    allowed = f"none: {placement} has {len(pair)} sockets, not two"
                    raise InvalidValue("socket distance", socket_distance, allowed)
            if not distances:
                allowed = "none: no placement has two sockets"
                raise InvalidValue("socket distance", socket_distance, allowed)
        return Measurements(
            self.joint_positions,
            fixed_points=numbers,
            distances=distances,
            frame_known=frame_known,
            tool_known=tool_known,
        )


def read_measurements(
    robot: Robot,
    paths: Sequence[str | Path],
    units: Units | None = None,
    *,
    position_only: bool = False,
) -> MeasuredRows:
    """The rows of tables, one after the other; with ``position_only`` without orientations.

    Raises:
        UnreadableMeasurements: naming file, line, column and value of what is wrong.
        UnlikelyUnits: if angles or lengths are of another size than the robot's.
        InvalidValue: if a unit is unknown.
    """
    units = _checked(units)
    return _joined(
        robot,
        [_read_table(robot, Path(path), units, position_only=position_only) for path in paths],
    )


def read_sockets(
    robot: Robot, folders: Sequence[str | Path], units: Units | None = None
) -> MeasuredRows:
    """Joint positions with a ball in sockets, from folders of placements.

    A placement is a folder with a file for each socket, ``hole_0.csv`` and ``hole_1.csv``: a row
    of joint positions in the robot's order for each configuration, without a header, or with one
    that names the joints. A folder of placements stands for all of them.

    Raises:
        UnreadableMeasurements: naming file, line, column and value of what is wrong.
        UnlikelyUnits: if angles are of another size than the robot's.
    """
    units = _checked(units)
    rows = []
    for placement in _placements(folders):
        for number, path in _socket_files(placement):
            read = _read_table(robot, path, units, joints_only=True)
            sockets = ((str(placement), number),) * len(read)
            rows.append(
                MeasuredRows(read.joint_positions, None, None, sockets, read.places, read.notes)
            )
    return _joined(robot, rows)


def _checked(units: Units | None) -> Units:
    units = units or Units()
    for name, unit, known in (
        ("length unit", units.length, LENGTH_UNITS),
        ("angle unit", units.angle, ANGLE_UNITS),
    ):
        if unit not in known:
            raise InvalidValue(name, unit, ", ".join(filter(None, known)))
    return units


def _joined(robot: Robot, tables: Sequence[MeasuredRows]) -> MeasuredRows:
    first = tables[0]
    for table in tables[1:]:
        for name, mine, other in (
            ("positions", table.positions, first.positions),
            ("orientations", table.rotations, first.rotations),
            ("sockets", table.sockets, first.sockets),
        ):
            if (mine is None) != (other is None):
                with_them, without = (first, table) if mine is None else (table, first)
                raise UnreadableMeasurements(
                    without.places[0][0],
                    f"it has no {name}, {with_them.places[0][0]} has them: give files of one kind",
                )
    positions = [table.positions for table in tables if table.positions is not None]
    rotations = [table.rotations for table in tables if table.rotations is not None]
    sockets = [entry for table in tables for entry in table.sockets or ()]
    joint_positions = np.concatenate([table.joint_positions for table in tables])
    notes = [note for table in tables for note in table.notes]
    places = [place for table in tables for place in table.places]
    arrays = [joint_positions, *map(np.concatenate, filter(None, (positions, rotations)))]
    kept, copies = _without_copies(tables, arrays)
    notes += copies
    return MeasuredRows(
        joint_positions[kept],
        np.concatenate(positions)[kept] if positions else None,
        np.concatenate(rotations)[kept] if rotations else None,
        tuple(sockets[row] for row in kept.tolist()) if sockets else None,
        tuple(places[row] for row in kept.tolist()),
        tuple(dict.fromkeys([*notes, *_notes_on_limits(robot, joint_positions[kept])])),
    )


def _without_copies(
    tables: Sequence[MeasuredRows], arrays: Sequence[FloatArray]
) -> tuple[NDArray[np.int64], list[str]]:
    """Rows that are used, and notes on tables of which most rows are in others before them.

    Such are copies; a few equal rows may have been measured.
    """
    rows = np.concatenate([array.reshape(len(array), -1) for array in arrays], axis=1)
    seen: dict[bytes, MeasuredRows] = {}
    kept, notes, begin = [], [], 0
    for table in tables:
        keys = [row.tobytes() for row in rows[begin : begin + len(table)]]
        before = [key for key in keys if key in seen]
        fresh = list(range(len(keys)))
        if 2 * len(before) > len(keys):
            first = seen[before[0]]
            if table.sockets and first.sockets and _same_placement(table, first):
                raise UnreadableMeasurements(
                    table.places[0][0],
                    f"its rows are those of {first.places[0][0]}: with the same joint positions "
                    "the ball is not in another socket",
                )
            fresh = [row for row, key in enumerate(keys) if key not in seen]
            notes.append(
                f"{len(before)} rows of {table.places[0][0]} are in {first.places[0][0]} too, to "
                "the last digit: they are used once"
            )
        kept += [begin + row for row in fresh]
        seen.update({key: table for key in keys if key not in seen})
        begin += len(table)
    return np.array(kept, dtype=np.int64), notes


def _same_placement(table: MeasuredRows, other: MeasuredRows) -> bool:
    """Whether two tables are of one placement, but of different sockets."""
    assert table.sockets is not None and other.sockets is not None
    return table.sockets[0][0] == other.sockets[0][0] and table.sockets[0] != other.sockets[0]


def _placements(folders: Sequence[str | Path]) -> Iterator[Path]:
    for given in folders:
        folder = expanded(given)
        try:
            inside = sorted(path for path in folder.iterdir() if path.is_dir())
            found = [path for path in (folder, *inside) if _socket_files(path)]
        except OSError as error:
            raise UnreadableMeasurements(folder, f"no folder: {error.strerror}") from error
        if not found:
            raise UnreadableMeasurements(
                folder, "neither it nor a folder in it has files hole_0.csv and hole_1.csv"
            )
        yield from found


def _socket_files(folder: Path) -> list[tuple[int, Path]]:
    named = [(_SOCKET_FILE.fullmatch(path.name), path) for path in folder.iterdir()]
    return sorted((int(match["number"]), path) for match, path in named if match)


@dataclass(frozen=True)
class _Column:
    """Where a quantity is in a line, and its unit."""

    index: int
    title: str
    unit: str = ""
    factor: float = 1.0


@dataclass(frozen=True)
class _Table:
    """The cells of a file, and what its columns are."""

    path: Path
    columns: Mapping[str, _Column]
    lines: Sequence[tuple[int, Sequence[str]]] = field(repr=False)

    def has(self, names: Sequence[str]) -> bool:
        """Whether there are all columns of a quantity; refuse a part of them."""
        missing = [name for name in names if name not in self.columns]
        if missing and len(missing) < len(names):
            raise UnreadableMeasurements(
                self.path, f"it has some of {', '.join(names)}, but lacks {', '.join(missing)}", 1
            )
        return not missing

    def numbers(self, names: Sequence[str]) -> FloatArray:
        """``(n, columns)`` in rad and m."""
        columns = [self.columns[name] for name in names]
        rows = [
            [self._number(line, cells, column) for column in columns] for line, cells in self.lines
        ]
        return np.array(rows) * [column.factor for column in columns]

    def _number(self, line: int, cells: Sequence[str], column: _Column) -> float:
        text = cells[column.index].strip()
        try:
            # Python's own notation of 1_000 is no other program's.
            number = math.nan if "_" in text else float(text.replace(",", "."))
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            problem = "not a finite number: correct it, or leave out the line"
            raise UnreadableMeasurements(self.path, problem, line, column.title, text)
        return number


def _read_table(
    robot: Robot,
    path: Path,
    units: Units,
    *,
    joints_only: bool = False,
    position_only: bool = False,
) -> MeasuredRows:
    lines = _lines(path, robot.joint_names)
    (number, header), *rest = lines
    if joints_only and all(map(_is_number, header)):
        if len(header) != robot.dof:
            problem = f"{len(header)} columns; the robot has {robot.dof} joints: {_joints(robot)}"
            raise UnreadableMeasurements(path, problem, number)
        header, rest = list(robot.joint_names), lines
    columns, unused = _columns(robot, header, units, path, number)
    if not rest:
        raise UnreadableMeasurements(path, "there is no line of numbers after the header")
    for line, cells in rest:
        if len(cells) != len(header):
            problem = f"{len(cells)} columns, but the header has {len(header)}"
            raise UnreadableMeasurements(path, problem, line)
    table = _Table(path, columns, rest)
    joint_positions = table.numbers(robot.joint_names)
    _check_angles(robot, table, joint_positions)
    notes = (f"columns that are not used: {', '.join(unused)}",) if unused else ()
    places = tuple((path, line) for line, _ in rest)
    if joints_only:
        return MeasuredRows(joint_positions, None, None, None, places, notes)
    sockets, positions, rotations = _sockets(table), None, None
    if table.has(POSITION):
        if sockets is not None:
            raise UnreadableMeasurements(
                path, f"it has both positions and the column {SOCKET}: leave out one of them", 1
            )
        positions = table.numbers(POSITION)
        rotations = None if position_only else _rotations(table)
        _check_lengths(robot, table, joint_positions, positions)
    elif sockets is None:
        raise UnreadableMeasurements(
            path,
            f"it lacks {', '.join(POSITION)}, or {SOCKET}; its columns: {', '.join(header)}",
            1,
        )
    return MeasuredRows(joint_positions, positions, rotations, sockets, places, notes)


def _lines(path: Path, joint_names: Sequence[str]) -> list[tuple[int, list[str]]]:
    """Number and cells of every line that is neither empty nor a comment."""
    try:
        text = read_text(path, _MOST_BYTES)
    except OSError as error:
        raise UnreadableMeasurements(path, error.strerror or str(error)) from error
    except ValueError as error:
        problem = f"not a text in UTF-8 ({error}): save it as CSV in UTF-8"
        raise UnreadableMeasurements(path, problem) from error
    written = _without_comments(text, joint_names)
    first = next((line for line in written if line.strip()), "")
    # Before the comma, which may be a decimal one.
    delimiter = next((one for one in ";\t" if one in first), ",")
    rows: Iterator[tuple[int, list[str]]]
    if delimiter in first:
        reader = csv.reader(StringIO("\n".join(written), newline=""), delimiter=delimiter)
        rows = ((reader.line_num, row) for row in reader)
    else:
        rows = ((number, line.split()) for number, line in enumerate(written, 1))
    lines: list[tuple[int, list[str]]] = []
    try:
        for number, row in rows:
            if any(cell.strip() for cell in row):
                lines.append((number, row))
    except csv.Error as error:
        raise UnreadableMeasurements(path, f"not a table: {error}") from error
    if not lines:
        raise UnreadableMeasurements(path, "it is empty")
    return lines


def _without_comments(text: str, joint_names: Sequence[str]) -> list[str]:
    """The lines, empty where there was a comment; one that names the joints may be the header.

    NumPy writes a header as a comment.
    """
    lines = text.splitlines()
    begin = next((n for n, line in enumerate(lines) if line.strip()[:1] not in ("", "#")), 0)
    cells = re.split(r"[;,\s]+", lines[begin].strip()) if lines else []
    numeric = all(map(_is_number, filter(None, cells)))
    for number in range(len(lines) - 1, -1, -1):
        line = lines[number].strip()
        if not line.startswith("#"):
            continue
        is_header = number < begin and numeric and all(name in line for name in joint_names)
        lines[number] = line.lstrip("#").strip() if is_header else ""
        numeric = numeric and not is_header
    return lines


def _columns(
    robot: Robot, header: Sequence[str], units: Units, path: Path, line: int
) -> tuple[dict[str, _Column], list[str]]:
    """The columns by name, and the titles of those that are not used."""
    if all(map(_is_number, header)):
        raise UnreadableMeasurements(
            path, f"the first line must name the columns: {_joints(robot)}, x, y, z, ...", line
        )
    columns: dict[str, _Column] = {}
    unused = []
    for index, title in enumerate(cell.strip() for cell in header):
        name, unit = _known_name(robot, title)
        if name is None:
            unused += [title] * bool(title)
            continue
        if name in columns:
            problem = f"columns {columns[name].title!r} and {title!r} are both {name}"
            raise UnreadableMeasurements(path, problem, line)
        length, angle = _is_length(robot, name), name in (*robot.joint_names, *ROTATION_VECTOR)
        known = LENGTH_UNITS if length else ANGLE_UNITS if angle else {"": 1.0}
        unit = unit or (units.length if length else units.angle if angle else "")
        if unit not in known:
            problem = f"is in {unit}, which is no unit of it; use {', '.join(filter(None, known))}"
            raise UnreadableMeasurements(path, problem, line, title)
        columns[name] = _Column(index, title, unit, known[unit])
    missing = [joint for joint in robot.joint_names if joint not in columns]
    if missing:
        raise UnreadableMeasurements(
            path,
            f"no column for joint {', '.join(missing)}; its columns: {', '.join(header)}",
            line,
        )
    return columns, unused


def _known_name(robot: Robot, title: str) -> tuple[str | None, str]:
    """The quantity that a title names, or None, and its unit if it has one."""
    quantities = (*POSITION, *QUATERNION, *ROTATION_VECTOR, SOCKET, PLACEMENT)
    match = _WITH_UNIT.fullmatch(title)
    for name, unit in ((title, ""), *([(match["name"], match["unit"])] if match else [])):
        if name in robot.joint_names:
            return name, unit
        if name.lower() in quantities:
            return name.lower(), unit
    return None, ""


def _is_length(robot: Robot, name: str) -> bool:
    prismatic = [
        joint
        for joint, kind in zip(robot.joint_names, robot.joint_types, strict=True)
        if kind == "prismatic"
    ]
    return name in (*POSITION, *prismatic)


def _sockets(table: _Table) -> tuple[tuple[str, int], ...] | None:
    if SOCKET not in table.columns:
        return None
    placement, column = table.columns.get(PLACEMENT), table.columns[SOCKET]
    found = []
    for (line, cells), number in zip(table.lines, table.numbers([SOCKET])[:, 0], strict=True):
        if number < 0 or number != int(number):
            text = cells[column.index].strip()
            raise UnreadableMeasurements(
                table.path, "not the number of a socket: 0, 1, ...", line, column.title, text
            )
        name = "" if placement is None else cells[placement.index].strip()
        found.append((f"{table.path} {name}".strip(), int(number)))
    return tuple(found)


def _rotations(table: _Table) -> FloatArray | None:
    has_quaternion, has_vector = table.has(QUATERNION), table.has(ROTATION_VECTOR)
    if has_quaternion and has_vector:
        raise UnreadableMeasurements(
            table.path, "it has both quaternions and rotation vectors: leave out one of them", 1
        )
    if has_vector:
        vectors = table.numbers(ROTATION_VECTOR)
        column = table.columns[ROTATION_VECTOR[0]]
        # A rotation is at most half a turn; some programs write up to a whole one.
        if np.abs(vectors).max() > 2.0 * math.pi + 0.1 and column.unit != "deg":
            raise UnlikelyUnits(table.path, "the rotation vectors", column.unit, "deg")
        matrices: FloatArray = Rotation.from_rotvec(vectors).as_matrix()
        return matrices
    if not has_quaternion:
        return None
    quaternions = table.numbers(QUATERNION)
    norms = np.linalg.norm(quaternions, axis=1)
    for row in np.flatnonzero(np.abs(norms - 1.0) > _NORM_TOLERANCE)[:1].tolist():
        raise UnreadableMeasurements(
            table.path,
            f"the quaternion x, y, z, w has the norm {norms[row]:.6g}, not 1",
            table.lines[row][0],
        )
    matrices = Rotation.from_quat(quaternions).as_matrix()
    return matrices


def _check_angles(robot: Robot, table: _Table, joint_positions: FloatArray) -> None:
    """Refuse joint positions in another unit."""
    limits = robot.joint_limits
    turns = robot.rotary
    columns = [table.columns[joint] for joint in robot.joint_names]
    given = {column.unit for column, turning in zip(columns, turns, strict=True) if turning}
    turned = joint_positions[:, turns]
    bounds = np.maximum(np.abs(limits.lower), np.abs(limits.upper))[turns]
    most = np.minimum(np.maximum(bounds, math.pi), _MOST_TURNS)
    largest = np.abs(turned).max(axis=0)
    if given == {"rad"} and (largest > _FAR * most).any() and (np.radians(largest) <= most).all():
        raise UnlikelyUnits(table.path, "the joint positions", "rad", "deg")
    if given == {"deg"} and len(turned) > 1 and (np.degrees(largest) <= most).all():
        raise UnlikelyUnits(table.path, "the joint positions", "deg", "rad")
    beyond = np.abs(joint_positions - np.clip(joint_positions, limits.lower, limits.upper))
    reach = np.where(turns, _FAR * math.pi, limits.upper - limits.lower)
    for row, joint in np.argwhere(beyond > reach)[:1].tolist():
        line, cells = table.lines[row]
        raise UnreadableMeasurements(
            table.path,
            f"far beyond the limits of the joint, {limits.lower[joint]:.4g} and "
            f"{limits.upper[joint]:.4g}: check its unit and which column is which joint",
            line,
            columns[joint].title,
            cells[columns[joint].index].strip(),
        )


def _notes_on_limits(robot: Robot, joint_positions: FloatArray) -> Iterator[str]:
    limits = robot.joint_limits
    outside = (joint_positions < limits.lower) | (joint_positions > limits.upper)
    for joint in np.flatnonzero(outside.any(axis=0)).tolist():
        yield (
            f"{robot.joint_names[joint]} was measured at {joint_positions[:, joint].min():.4g} to "
            f"{joint_positions[:, joint].max():.4g}; the description has the limits "
            f"{limits.lower[joint]:.4g} and {limits.upper[joint]:.4g}"
        )


def _check_lengths(
    robot: Robot, table: _Table, joint_positions: FloatArray, positions: FloatArray
) -> None:
    """Refuse positions whose spread is another unit's; their frame and the tool are unknown."""
    nominal = robot.forward_kinematics.poses(joint_positions)[:, :3]
    measured, expected = map(_spread, (positions, nominal))
    reach = float(getattr(robot.workspace, "reach", np.abs(nominal).max()))
    column = table.columns[POSITION[0]]
    if measured > _SCALE * max(reach, expected) or (
        _SCALE * measured < expected and expected > _MOVED * reach
    ):
        factor = column.factor * expected / max(measured, 1e-12)
        units = {unit: one for unit, one in LENGTH_UNITS.items() if unit}
        likely = min(units, key=lambda unit: abs(math.log(units[unit] / factor)))
        if likely != column.unit:
            raise UnlikelyUnits(table.path, "the positions", column.unit, likely)


def _spread(positions: FloatArray) -> float:
    """Median distance from the middle."""
    return float(np.median(np.linalg.norm(positions - np.median(positions, axis=0), axis=1)))


def _is_number(text: str) -> bool:
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _joints(robot: Robot) -> str:
    return ", ".join(robot.joint_names)
