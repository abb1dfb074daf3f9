"""Measurements from files: what is read, and what is refused with its place. ROS-free."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from annik_core.errors import AnnikError, InvalidValue
from annik_core.robots.library import load_robot
from annik_training.calibration.errors import UnlikelyUnits, UnreadableMeasurements
from annik_training.calibration.measurement_files import (
    MeasuredRows,
    Units,
    read_measurements,
    read_sockets,
)

DATA = Path(__file__).parents[4] / "shared" / "data"
UR5E = load_robot("ur5e")
SCARA = load_robot("scara")
JOINTS = UR5E.joint_names
JOINT_POSITIONS = UR5E.joint_box.sample(12, np.random.default_rng(0))
#: Of two placements, whose rows are not the same.
SHIFTS = {"left": 0.0, "right": 1e-3}
POSES = UR5E.forward_kinematics.poses(JOINT_POSITIONS)


def table(
    columns: dict[str, np.ndarray], delimiter: str = ",", end: str = "\n", mark: str = ""
) -> str:
    rows = np.stack([np.broadcast_to(column, 12) for column in columns.values()], axis=1)
    lines = [columns, *([repr(number) for number in row] for row in rows.tolist())]
    text = end.join(delimiter.join(line) for line in lines) + end
    return mark + text


def joint_columns(factor: float = 1.0, suffix: str = "") -> dict[str, np.ndarray]:
    return {
        f"{joint}{suffix}": factor * values
        for joint, values in zip(JOINTS, JOINT_POSITIONS.T, strict=True)
    }


def pose_columns(factor: float = 1.0, suffix: str = "") -> dict[str, np.ndarray]:
    position = {f"{name}{suffix}": factor * POSES[:, at] for at, name in enumerate("xyz")}
    return {**position, **{f"q{name}": POSES[:, 3 + at] for at, name in enumerate("xyzw")}}


def read(tmp_path: Path, text: str, units: Units | None = None) -> MeasuredRows:
    path = tmp_path / "measured.csv"
    path.write_bytes(text.encode())
    return read_measurements(UR5E, [path], units)


def check(rows: MeasuredRows) -> None:
    assert rows.positions is not None
    assert rows.rotations is not None
    assert np.allclose(rows.joint_positions, JOINT_POSITIONS, rtol=0, atol=1e-12)
    assert np.allclose(rows.positions, POSES[:, :3], rtol=0, atol=1e-12)
    expected = Rotation.from_quat(POSES[:, 3:]).as_matrix()
    assert np.allclose(rows.rotations, expected, rtol=0, atol=1e-12)
    assert [line for _, line in rows.places] == list(range(2, 14))


class TestTable:
    """One with named columns."""

    @pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
    @pytest.mark.parametrize("end", ["\n", "\r\n"])
    @pytest.mark.parametrize("mark", ["", "\ufeff", "# "])
    def test_of_any_program(self, tmp_path: Path, delimiter: str, end: str, mark: str) -> None:
        if (delimiter, mark) == (" ", "# "):
            mark = "#"
        columns = {**pose_columns(), **dict(reversed(joint_columns().items()))}
        check(read(tmp_path, table(columns, delimiter, end, mark)))

    @pytest.mark.parametrize("mark", ["", "# "])
    def test_comments_above_it_are_left_out(self, tmp_path: Path, mark: str) -> None:
        comments = f"# with a tracker\n\n#second; line\n# {JOINTS[-1]} is the flange\n"
        text = table({**joint_columns(), **pose_columns()})
        rows = read(tmp_path, comments + mark + text)
        assert np.allclose(rows.joint_positions, JOINT_POSITIONS, rtol=0, atol=1e-12)
        assert [line for _, line in rows.places] == list(range(6, 18))

    def test_orientations_that_are_none_can_be_left_out(self, tmp_path: Path) -> None:
        zeros = {name: np.zeros(12) for name in ("qx", "qy", "qz", "qw")}
        path = tmp_path / "measured.csv"
        path.write_text(table({**joint_columns(), **pose_columns(), **zeros}))
        rows = read_measurements(UR5E, [path], position_only=True)
        assert rows.positions is not None
        assert rows.rotations is None

    def test_with_decimal_commas(self, tmp_path: Path) -> None:
        text = table({**joint_columns(), **pose_columns()}, ";").replace(".", ",")
        check(read(tmp_path, text))

    @pytest.mark.parametrize(("joint", "length"), [("_deg", "_mm"), (" [deg]", " (mm)")])
    def test_with_units_in_the_header(self, tmp_path: Path, joint: str, length: str) -> None:
        columns = {**joint_columns(180 / math.pi, joint), **pose_columns(1e3, length)}
        check(read(tmp_path, table(columns)))

    def test_with_units_by_option(self, tmp_path: Path) -> None:
        """For the columns that name none."""
        columns = {**joint_columns(180 / math.pi), **pose_columns(1.0, "_m")}
        check(read(tmp_path, table(columns), Units("mm", "deg")))
        columns = {**joint_columns(1.0, "_rad"), **pose_columns(100.0)}
        check(read(tmp_path, table(columns), Units("cm", "deg")))

    def test_with_a_rotation_vector(self, tmp_path: Path) -> None:
        vectors = np.degrees(Rotation.from_quat(POSES[:, 3:]).as_rotvec())
        turns = {f"r{name}_deg": vectors[:, at] for at, name in enumerate("xyz")}
        positions = dict(list(pose_columns().items())[:3])
        check(read(tmp_path, table({**joint_columns(), **positions, **turns})))

    def test_of_positions_alone(self, tmp_path: Path) -> None:
        positions = dict(list(pose_columns().items())[:3])
        rows = read(tmp_path, table({**joint_columns(), **positions}))
        assert rows.rotations is None

    def test_other_columns_are_noted(self, tmp_path: Path) -> None:
        more = {"sigma": np.ones(12), "temperature": np.full(12, 21.5)}
        rows = read(tmp_path, table({**more, **joint_columns(), **pose_columns()}))
        check(rows)
        (note,) = rows.notes
        assert "sigma, temperature" in note

    def test_a_joint_beyond_its_limits_is_noted(self, tmp_path: Path) -> None:
        columns = {**joint_columns(), **pose_columns()}
        columns["elbow_joint"] = np.full(12, UR5E.joint_limits.upper[2] + 0.3)
        (note,) = read(tmp_path, table(columns)).notes
        assert note.startswith("elbow_joint")

    def test_several_files(self, tmp_path: Path) -> None:
        other = table({**pose_columns(), **joint_columns(1.0 + 1e-9)})
        (tmp_path / "other.csv").write_text(other)
        read(tmp_path, table({**joint_columns(), **pose_columns()}))
        paths = [tmp_path / "measured.csv", tmp_path / "other.csv"]
        assert len(read_measurements(UR5E, paths)) == 24
        twice = read_measurements(UR5E, [paths[0], *paths])
        assert [line for _, line in twice.places] == 2 * list(range(2, 14))
        assert any(note.startswith("12 rows of") for note in twice.notes)
        positions = dict(list(pose_columns().items())[:3])
        (tmp_path / "other.csv").write_text(table({**joint_columns(), **positions}))
        with pytest.raises(UnreadableMeasurements):
            read_measurements(UR5E, paths)

    def test_a_prismatic_joint_is_a_length(self, tmp_path: Path) -> None:
        joint_positions = SCARA.joint_box.sample(5, np.random.default_rng(0))
        poses = SCARA.forward_kinematics.poses(joint_positions)
        prismatic = np.array([kind == "prismatic" for kind in SCARA.joint_types])
        shown = joint_positions * np.where(prismatic, 1e3, 1.0)
        path = tmp_path / "scara.csv"
        numbers = np.hstack([shown, 1e3 * poses[:, :3]])
        header = ",".join([*SCARA.joint_names, "x", "y", "z"])
        np.savetxt(path, numbers, delimiter=",", header=header)
        rows = read_measurements(SCARA, [path], Units(length="mm"))
        assert np.allclose(rows.joint_positions, joint_positions)


def without(columns: dict[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    return {key: column for key, column in columns.items() if key != name}


class TestRefusal:
    """Names the file, and the line, column and value where there is one."""

    def changed(self, before: str, after: str) -> str:
        text = table({**joint_columns(), **pose_columns()})
        assert before in text
        return text.replace(before, after, 1)

    @pytest.mark.parametrize("text", ["", "\n \n", "\ufeff", "\x00", "a\n1\n", '"'])
    def test_what_is_no_table(self, tmp_path: Path, text: str) -> None:
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, text)
        assert caught.value.path == tmp_path / "measured.csv"

    @pytest.mark.parametrize("value", ["nan", "inf", "", "?", "1_000", "0x1p3"])
    def test_a_cell_that_is_no_number(self, tmp_path: Path, value: str) -> None:
        number = repr(JOINT_POSITIONS[3, 2].item())
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, self.changed(number, value))
        found = caught.value
        assert (found.line, found.column, found.value) == (5, "elbow_joint", value)

    def test_a_short_line(self, tmp_path: Path) -> None:
        number = repr(JOINT_POSITIONS[3, 2].item())
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, self.changed(number + ",", ""))
        assert caught.value.line == 5

    @pytest.mark.parametrize("name", ["elbow_joint", "y", "qw"])
    def test_a_missing_column(self, tmp_path: Path, name: str) -> None:
        columns = without({**joint_columns(), **pose_columns()}, name)
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, table(columns))
        assert name in caught.value.problem

    def test_a_column_twice(self, tmp_path: Path) -> None:
        columns = {**joint_columns(), **pose_columns(), "x_mm": POSES[:, 0]}
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, table(columns))
        assert "'x_mm'" in caught.value.problem

    def test_no_header(self, tmp_path: Path) -> None:
        text = table({**joint_columns(), **pose_columns()})
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, text.partition("\n")[2])
        assert caught.value.line == 1

    def test_a_quaternion_of_another_norm(self, tmp_path: Path) -> None:
        number = repr(POSES[3, 4].item())
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, self.changed(number, "2.5"))
        assert caught.value.line == 5

    @pytest.mark.parametrize(
        ("joints", "lengths", "units", "likely"),
        [
            (180 / math.pi, 1.0, None, "deg"),
            (1.0, 1.0, Units("m", "deg"), "rad"),
            (1.0, 1e3, None, "mm"),
            (1.0, 100.0, None, "cm"),
            (1.0, 1.0, Units("mm"), "m"),
        ],
    )
    def test_another_unit(
        self, tmp_path: Path, joints: float, lengths: float, units: Units | None, likely: str
    ) -> None:
        """Whatever the frame and the tool are."""
        columns = {**joint_columns(joints), **pose_columns(lengths)}
        columns["x"] = columns["x"] + 20.0 * lengths
        with pytest.raises(UnlikelyUnits) as caught:
            read(tmp_path, table(columns), units)
        assert caught.value.likely == likely
        assert f"-unit {likely}" in str(caught.value)

    def test_an_unknown_unit(self, tmp_path: Path) -> None:
        with pytest.raises(InvalidValue):
            read(tmp_path, table(joint_columns()), Units("furlong"))
        columns = {**joint_columns(1.0, "_mm"), **pose_columns()}
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, table(columns))
        assert caught.value.column == f"{JOINTS[0]}_mm"

    def test_a_missing_file(self, tmp_path: Path) -> None:
        for path in (tmp_path / "none.csv", tmp_path):
            with pytest.raises(UnreadableMeasurements):
                read_measurements(UR5E, [path])

    @settings(max_examples=150, deadline=None)
    @given(
        at=st.integers(0, 3000),
        count=st.integers(0, 40),
        more=st.text(alphabet='0123456789,;.\t\n\r "eE+-#xyznaif_\x00ü', max_size=12),
    )
    def test_any_damage_is_read_or_refused(
        self, tmp_path_factory: pytest.TempPathFactory, at: int, count: int, more: str
    ) -> None:
        """As an error of annik, never another."""
        text = table({**joint_columns(), **pose_columns()})
        folder = tmp_path_factory.getbasetemp()
        try:
            rows = read(folder, text[:at] + more + text[at + count :])
        except AnnikError:
            return
        assert rows.positions is not None
        assert np.isfinite(rows.positions).all()
        assert len(rows.positions) == len(rows.joint_positions) == len(rows.places)


class TestSockets:
    """Joint positions with a ball in sockets."""

    def folder(self, tmp_path: Path) -> Path:
        for placement in ("left", "right"):
            (tmp_path / "robot" / placement).mkdir(parents=True)
            for hole in (0, 1):
                path = tmp_path / "robot" / placement / f"hole_{hole}.csv"
                rows = JOINT_POSITIONS[6 * hole : 6 * hole + 6] + SHIFTS[placement]
                np.savetxt(path, rows, delimiter=",")
        return tmp_path / "robot"

    def test_of_a_folder(self, tmp_path: Path) -> None:
        folder = self.folder(tmp_path)
        rows = read_sockets(UR5E, [folder])
        expected = [JOINT_POSITIONS + shift for shift in SHIFTS.values()]
        assert np.array_equal(rows.joint_positions, np.concatenate(expected))
        assert rows.sockets == tuple(
            (str(folder / placement), hole)
            for placement in ("left", "right")
            for hole in (0, 1)
            for _ in range(6)
        )
        assert rows.positions is None
        assert len(read_sockets(UR5E, [folder / "left"])) == 12

    def test_are_fixed_points_with_a_distance(self, tmp_path: Path) -> None:
        rows = read_sockets(UR5E, [self.folder(tmp_path)])
        measurements = rows.measurements(socket_distance=0.05)
        assert measurements.fixed_points is not None
        assert measurements.fixed_points.tolist() == [n for n in range(4) for _ in range(6)]
        assert list(measurements.distances) == [(0, 1, 0.05), (2, 3, 0.05)]
        assert not rows.measurements().distances

    def test_a_copied_placement_is_used_once(self, tmp_path: Path) -> None:
        folder = self.folder(tmp_path)
        shutil.copytree(folder / "left", folder / "middle")
        rows = read_sockets(UR5E, [folder])
        assert len(rows) == 24
        assert sum("used once" in note for note in rows.notes) == 2

    def test_a_socket_can_not_be_another(self, tmp_path: Path) -> None:
        folder = self.folder(tmp_path)
        shutil.copy(folder / "left" / "hole_0.csv", folder / "left" / "hole_1.csv")
        with pytest.raises(UnreadableMeasurements) as caught:
            read_sockets(UR5E, [folder])
        assert caught.value.path == folder / "left" / "hole_1.csv"

    def test_some_equal_rows_were_measured(self, tmp_path: Path) -> None:
        """Of repeated approaches, with few digits."""
        folder = self.folder(tmp_path)
        path = folder / "right" / "hole_1.csv"
        lines = path.read_text().splitlines()
        path.write_text("\n".join([lines[0], *lines]))
        assert len(read_sockets(UR5E, [folder])) == 25

    def test_a_place_with_one_socket_has_no_distance(self, tmp_path: Path) -> None:
        folder = self.folder(tmp_path)
        (folder / "right" / "hole_1.csv").unlink()
        measurements = read_sockets(UR5E, [folder]).measurements(socket_distance=0.05)
        assert list(measurements.distances) == [(0, 1, 0.05)]
        with pytest.raises(InvalidValue):
            read_sockets(UR5E, [folder / "right"]).measurements(socket_distance=0.05)

    def test_a_distance_is_between_two(self, tmp_path: Path) -> None:
        columns = {**joint_columns(), "socket": np.arange(12) % 3}
        with pytest.raises(InvalidValue):
            read(tmp_path, table(columns)).measurements(socket_distance=0.05)
        poses = read(tmp_path, table({**joint_columns(), **pose_columns()}))
        with pytest.raises(InvalidValue):
            poses.measurements(socket_distance=0.05)
        measurements = poses.measurements(frame_known=True)
        assert (measurements.frame_known, measurements.tool_known) == (True, False)
        assert len(measurements) == 12

    def test_of_a_table(self, tmp_path: Path) -> None:
        columns = {**joint_columns(), "placement": np.arange(12) // 6, "socket": np.arange(12) % 2}
        rows = read(tmp_path, table(columns))
        assert rows.sockets is not None
        assert len(set(rows.sockets)) == 4
        assert [socket for _, socket in rows.sockets] == [0, 1] * 6

    @pytest.mark.parametrize("socket", [0.5, -1.0])
    def test_a_socket_has_a_number(self, tmp_path: Path, socket: float) -> None:
        with pytest.raises(UnreadableMeasurements) as caught:
            read(tmp_path, table({**joint_columns(), "socket": np.full(12, socket)}))
        assert caught.value.column == "socket"

    def test_other_joints_are_refused(self, tmp_path: Path) -> None:
        folder = self.folder(tmp_path)
        with pytest.raises(UnreadableMeasurements) as caught:
            read_sockets(SCARA, [folder])
        assert caught.value.path.name == "hole_0.csv"

    def test_a_folder_without_any_is_refused(self, tmp_path: Path) -> None:
        for folder in (tmp_path, tmp_path / "none"):
            with pytest.raises(UnreadableMeasurements):
                read_sockets(UR5E, [folder])


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data is not beside this checkout")
class TestDataOfOthers:
    """Read as they are."""

    @pytest.mark.parametrize("name", ["ur10_B", "ur10_C", "panda_camera"])
    def test_measured(self, name: str) -> None:
        folder = DATA / "measured" / name
        robot = load_robot(folder / "nominal_flange.urdf")
        rows = read_measurements(robot, [folder / "measured_in_tracker_frame.csv"])
        assert rows.rotations is not None

    @pytest.mark.parametrize(
        ("name", "urdf", "placements"),
        [
            ("panda_1", "panda", 3),
            ("panda_3", "panda", 6),
            ("kuka_14", "iiwa14", 3),
            ("dinova_1", "gen3lite", 4),
        ],
    )
    def test_sockets(self, name: str, urdf: str, placements: int) -> None:
        robot = load_robot(
            DATA / "sockets" / "nominal" / f"{urdf}.urdf", end_effector_frame="ball_link"
        )
        rows = read_sockets(robot, [DATA / "sockets" / name])
        assert rows.sockets is not None
        assert len(set(rows.sockets)) == 2 * placements
