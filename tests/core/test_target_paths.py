"""Paths of target poses. Needs no ROS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from annik_core.errors import InvalidValue, NonFiniteValue
from annik_core.pose import pose_from_roll_pitch_yaw
from annik_core.robots.library import load_robot
from annik_core.target_paths import (
    UnreadableTargetFile,
    circle_path,
    csv_path,
    diagonal_path,
    line_path,
)

HEADER = "x,y,z,qx,qy,qz,qw"
GOOD_LINE = "0.3,0.3,0.6,0,0,0,1"


def _roll_pitch_yaw(path: np.ndarray) -> np.ndarray:
    return Rotation.from_quat(path[:, 3:]).as_euler("xyz", degrees=True)


def test_the_diagonal_has_the_papers_points() -> None:
    """15 points, 20 mm apart along each axis, from P1 to P2."""
    path = diagonal_path()
    assert path.shape == (15, 7)
    np.testing.assert_allclose(path[0], [0.21, 0.21, 0.51, 0, 0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(path[-1, :3], [0.49, 0.49, 0.79], atol=1e-15)
    np.testing.assert_allclose(np.diff(path[:, :3], axis=0), 0.02, atol=1e-15)


def test_the_diagonal_turns_evenly_about_z_to_90_degrees() -> None:
    """6.4286 degrees a step; roll and pitch stay zero."""
    angles = _roll_pitch_yaw(diagonal_path())
    np.testing.assert_allclose(angles[:, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(angles[:, 2]), 90 / 14, atol=1e-12)
    assert angles[-1, 2] == pytest.approx(90.0)


@pytest.mark.parametrize("points", [2, 15, 141, 1000])
def test_the_diagonal_stays_in_the_gantrys_workspace(points: int) -> None:
    """At every fineness, its ends included."""
    workspace = load_robot("gantry").workspace
    violations = [workspace.resolve(pose, None).violation for pose in diagonal_path(points)]
    assert violations == [None] * points


def test_a_finer_diagonal_passes_through_the_coarse_one() -> None:
    """More points, same path."""
    np.testing.assert_allclose(diagonal_path(141)[::10], diagonal_path(15), atol=1e-15)


@pytest.mark.parametrize("points", [-1, 0, 1])
def test_a_path_has_two_points_at_least(points: int) -> None:
    """Fewer are refused by every path that counts them."""
    pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    for make in (
        lambda: diagonal_path(points),
        lambda: line_path(pose, pose, points),
        lambda: circle_path((0, 0, 0), 1.0, (0, 0, 0), points),
    ):
        with pytest.raises(InvalidValue) as caught:
            make()
        assert (caught.value.name, caught.value.value) == ("points", points)


def test_a_line_is_straight_and_even() -> None:
    """Steps of position are equal, and so are steps of angle, about one axis."""
    start = pose_from_roll_pitch_yaw([0.1, 0.2, 0.3], [0.1, 0.2, 0.3])
    end = pose_from_roll_pitch_yaw([0.5, 0.1, 0.9], [1.0, 0.5, 0.9])
    path = line_path(start, end, 9)
    np.testing.assert_allclose(path[[0, -1]], [start, end], atol=1e-12)
    np.testing.assert_allclose(np.diff(path[:, :3], 2, axis=0), 0.0, atol=1e-12)
    rotations = Rotation.from_quat(path[:, 3:])
    turns = (rotations[1:] * rotations[:-1].inv()).as_rotvec()
    np.testing.assert_allclose(turns, np.tile(turns[0], (8, 1)), atol=1e-12)


def test_a_line_takes_the_short_way_round() -> None:
    """The sign of a quaternion is not a full turn."""
    start = np.array([0, 0, 0, 0, 0, 0, 1.0])
    end = -pose_from_roll_pitch_yaw([0, 0, 0], [0, 0, 0.2])
    assert np.abs(_roll_pitch_yaw(line_path(start, end, 5))[:, 2]).max() == pytest.approx(
        np.degrees(0.2)
    )


def test_a_line_refuses_an_end_that_is_no_pose() -> None:
    """With the error of the pose."""
    with pytest.raises(NonFiniteValue):
        line_path([np.nan, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 1], 3)


@given(st.floats(0.001, 10.0), st.integers(2, 100))
def test_a_circle_keeps_its_radius_height_and_orientation(radius: float, points: int) -> None:
    """Every point is at the radius from the centre; the first is at the greatest x."""
    path = circle_path((1.0, 2.0, 3.0), radius, (0.1, 0.2, 0.3), points)
    distances = np.linalg.norm(path[:, :2] - [1.0, 2.0], axis=1)
    np.testing.assert_allclose(distances, radius, rtol=1e-9)
    assert (path[:, 2] == 3.0).all()
    assert (path[:, 3:] == path[0, 3:]).all()
    np.testing.assert_allclose(path[0, :2], [1.0 + radius, 2.0])


def test_laps_of_a_circle_join() -> None:
    """From the last point to the first is one step like any other."""
    path = circle_path((0, 0, 0), 1.0, (0, 0, 0), 12)
    steps = np.linalg.norm(np.diff(np.vstack([path, path[:1]])[:, :3], axis=0), axis=1)
    np.testing.assert_allclose(steps, steps[0])


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
def test_a_circle_needs_a_radius(radius: float) -> None:
    """Zero and what is not a number are refused."""
    with pytest.raises(InvalidValue) as caught:
        circle_path((0, 0, 0), radius, (0, 0, 0), 5)
    assert caught.value.name == "radius"


@pytest.mark.parametrize("points", [2, 100])
def test_the_default_orientation_is_kept_by_unit_quaternions(points: int) -> None:
    """Every path gives unit quaternions with a w that is not negative."""
    for path in (diagonal_path(points), circle_path((0, 0, 0), 1.0, (0.5, 0.5, 0.5), points)):
        np.testing.assert_allclose(np.linalg.norm(path[:, 3:], axis=1), 1.0, atol=1e-12)
        assert (path[:, 6] >= 0).all()


def _file(folder: Path, *lines: str) -> Path:
    path = folder / "targets.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_file_gives_its_poses_in_order(tmp_path: Path) -> None:
    """In any column order, with other columns, spaces, empty lines and a byte order mark."""
    path = _file(
        tmp_path,
        "\ufefflabel, qw, qx, qy, qz, x, y, z",
        "a, 1, 0, 0, 0, 0.1, 0.2, 0.3",
        "",
        "b, 1, 0, 0, 0, 0.4, 0.5, 0.6",
    )
    np.testing.assert_array_equal(
        csv_path(path), [[0.1, 0.2, 0.3, 0, 0, 0, 1], [0.4, 0.5, 0.6, 0, 0, 0, 1]]
    )


@pytest.mark.parametrize(
    ("lines", "line", "problem"),
    [
        (["x,y,z"], 1, "lacks qx, qy, qz, qw"),
        ([GOOD_LINE], 1, "the header must name"),
        ([""], 1, "the header must name"),
        ([HEADER], None, "no target"),
        ([HEADER, GOOD_LINE, "0.3,0.3"], 3, "too few columns"),
        ([HEADER, GOOD_LINE, "0.3,0.3,high,0,0,0,1"], 3, "high"),
        ([HEADER, "0.3,,0.6,0,0,0,1"], 2, "could not convert"),
        ([HEADER, "nan,0.3,0.6,0,0,0,1"], 2, "position.x is nan"),
        ([HEADER, "0.3,0.3,0.6,0,0,0,0"], 2, "quaternion norm is 0"),
        ([HEADER, "", GOOD_LINE, "inf,0.3,0.6,0,0,0,1"], 4, "position.x is inf"),
    ],
)
def test_a_bad_file_is_refused_with_the_line(
    tmp_path: Path, lines: list[str], line: int | None, problem: str
) -> None:
    """The error says where and what."""
    with pytest.raises(UnreadableTargetFile) as caught:
        csv_path(_file(tmp_path, *lines))
    assert caught.value.line == line
    assert problem in caught.value.problem
    if line is not None:
        assert f"line {line}" in str(caught.value)


def test_a_file_that_is_not_there_or_not_text_is_refused(tmp_path: Path) -> None:
    """As an error of the path, not of Python."""
    for path in (tmp_path / "none.csv", tmp_path):
        with pytest.raises(UnreadableTargetFile) as caught:
            csv_path(path)
        assert (caught.value.path, caught.value.line) == (path, None)
    binary = tmp_path / "targets.csv"
    binary.write_bytes(b"\x89ONNX\xff\xfe\x00")
    with pytest.raises(UnreadableTargetFile):
        csv_path(binary)
