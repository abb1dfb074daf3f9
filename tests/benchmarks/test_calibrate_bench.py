"""The calibrations that annik is compared with, and how they are judged. ROS-free."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.spatial.transform import Rotation

from annik_core.robots.library import load_robot
from benchmarks.calibrate import methods
from benchmarks.calibrate.command import calibrate
from benchmarks.calibrate.geometry import Chain, FloatArray, fit_poses, fit_sockets
from benchmarks.calibrate.problems import BALL, find_sets

UR5E = load_robot("ur5e")
NOMINAL = Chain.from_urdf(UR5E.definition["urdf"])
RNG = np.random.default_rng(0)
JOINT_POSITIONS = UR5E.joint_box.sample(80, RNG)


def imperfect() -> Chain:
    motions = RNG.normal(size=(7, 6)) * ([math.radians(0.2)] * 3 + [5e-4] * 3)
    return Chain(NOMINAL.placements, NOMINAL.axes, NOMINAL.turns, motions)


TRUTH = imperfect()
#: The instrument turned by more than a right angle and metres away, the tool decimetres.
BASE_TURN, BASE = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix(), np.array([3.0, -2.0, 1.0])
TOOL_TURN, TOOL = Rotation.from_rotvec([0.0, 2.0, 1.0]).as_matrix(), np.array([0.1, 0.2, -0.1])


def measured(joint_positions: FloatArray) -> tuple[FloatArray, FloatArray]:
    position, rotation = TRUTH.poses(joint_positions)
    position = (position + rotation @ TOOL) @ BASE_TURN.T + BASE
    return position, BASE_TURN @ rotation @ TOOL_TURN


def test_kinematics_are_those_of_annik() -> None:
    """Which were written without them."""
    position, rotation = NOMINAL.poses(JOINT_POSITIONS)
    poses = UR5E.forward_kinematics.poses(JOINT_POSITIONS)
    assert np.allclose(position, poses[:, :3], atol=1e-12)
    assert np.allclose(rotation, Rotation.from_quat(poses[:, 3:]).as_matrix(), atol=1e-12)


def test_derivatives_are_those_of_differences() -> None:
    position, rotation, columns = TRUTH.evaluate(JOINT_POSITIONS[:3])
    for place in range(7):
        for part in range(6):
            motions = np.zeros((7, 6))
            motions[place, part] = 1e-6
            # At motions of zero the derivatives are exact.
            still = Chain(NOMINAL.placements, NOMINAL.axes, NOMINAL.turns, np.zeros((7, 6)))
            moved = Chain(NOMINAL.placements, NOMINAL.axes, NOMINAL.turns, motions)
            position, rotation, columns = still.evaluate(JOINT_POSITIONS[:3])
            there, turned = moved.poses(JOINT_POSITIONS[:3])
            turn = Rotation.from_matrix(turned @ np.swapaxes(rotation, 1, 2)).as_rotvec()
            found = np.hstack([there - position, turn]) / 1e-6
            assert np.allclose(found, columns[:, :, 6 * place + part], atol=1e-5)


@pytest.mark.parametrize("with_rotations", [True, False])
def test_poses_in_an_unknown_frame_with_an_unknown_tool(with_rotations: bool) -> None:
    position, rotation = measured(JOINT_POSITIONS[:50])
    arguments = (JOINT_POSITIONS[:50], position, rotation if with_rotations else None)
    held_out, _ = measured(JOINT_POSITIONS[50:])
    errors = []
    for frames_only in (True, False):
        found = fit_poses(NOMINAL, *arguments, frames_only=frames_only)
        there, _ = found.poses(JOINT_POSITIONS[50:])
        errors.append(float(np.linalg.norm(there - held_out, axis=1).mean()))
    assert errors[0] > 5e-4
    assert errors[1] < 3e-5


def test_the_frames_are_told_apart_from_the_robot() -> None:
    place, turn = NOMINAL.poses(JOINT_POSITIONS)
    position = (place + turn @ TOOL) @ BASE_TURN.T + BASE
    found = fit_poses(
        NOMINAL, JOINT_POSITIONS, position, BASE_TURN @ turn @ TOOL_TURN, frames_only=True
    )
    base, tool = found.frames_beside(NOMINAL)
    assert np.allclose(base[:3, :3], BASE_TURN, atol=1e-6)
    assert np.allclose(base[:3, 3], BASE, atol=1e-6)
    assert np.allclose(tool[:3, :3], TOOL_TURN, atol=1e-6)
    assert np.allclose(tool[:3, 3], TOOL, atol=1e-6)


def in_sockets(truth: Chain, socket: FloatArray, count: int, seed: int) -> FloatArray:
    """Joint positions ``(count, 6)`` with the end effector at a point, by Newton's steps."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        joint_positions = UR5E.joint_box.sample(1, rng)
        for _ in range(30):
            place, _, columns = truth.evaluate(joint_positions)
            turns = columns[0, :3].reshape(3, 7, 6)[:, 1:, :3]
            jacobian = np.einsum("pji,ji->pj", turns, truth.axes)
            step = np.linalg.lstsq(jacobian, socket - place[0], rcond=None)[0]
            joint_positions = joint_positions + np.clip(step, -0.3, 0.3)
        if np.linalg.norm(truth.poses(joint_positions)[0] - socket) < 1e-8:
            found.append(joint_positions[0])
    return np.array(found)


def test_a_ball_in_two_sockets() -> None:
    """At three places; nothing but joint positions and one distance is known."""
    places = np.array([[0.4, 0.1, 0.2], [-0.3, 0.4, 0.3], [0.1, -0.5, 0.4]])
    across = np.array([0.05, 0.0, 0.0])
    sockets = [point for place in places for point in (place, place + across)]
    parts = [in_sockets(TRUTH, point, 14, seed) for seed, point in enumerate(sockets)]
    numbers = np.repeat(np.arange(4), 14)
    rows = np.concatenate(parts[:4])
    spreads = []
    for frames_only in (True, False):
        distances = [(0, 1, 0.05), (2, 3, 0.05)]
        found = fit_sockets(NOMINAL, rows, numbers, distances, frames_only=frames_only)
        balls = [found.poses(part)[0] for part in parts[4:]]
        away = [np.linalg.norm(ball - ball.mean(axis=0), axis=1) for ball in balls]
        spreads.append(float(np.concatenate(away).mean()))
    assert spreads[1] < 0.3 * spreads[0]


def written(folder: Path) -> Path:
    """Two sets, as those of others are laid out."""
    inside = folder / "measured" / "ur5e"
    inside.mkdir(parents=True)
    (inside / "nominal.urdf").write_text(UR5E.definition["urdf"], encoding="utf-8")
    position, rotation = measured(JOINT_POSITIONS)
    table = np.hstack([JOINT_POSITIONS, position, Rotation.from_matrix(rotation).as_quat()])
    header = ",".join([*UR5E.joint_names, "x", "y", "z", "qx", "qy", "qz", "qw"])
    np.savetxt(inside / "measured.csv", table, delimiter=",", header=header, comments="")
    sockets = folder / "sockets"
    (sockets / "nominal").mkdir(parents=True)
    urdf = UR5E.definition["urdf"].replace(f'"{UR5E.end_effector_frame}"', f'"{BALL}"')
    (sockets / "nominal" / "ur5e.urdf").write_text(urdf, encoding="utf-8")
    for place in ("left", "right"):
        (sockets / "one" / place).mkdir(parents=True)
        for hole in (0, 1):
            path = sockets / "one" / place / f"hole_{hole}.csv"
            np.savetxt(path, JOINT_POSITIONS[10 * hole : 10 * hole + 10], delimiter=",")
    return folder


def test_sets_are_found_and_split(tmp_path: Path) -> None:
    sets = find_sets(written(tmp_path))
    assert list(sets) == ["ur5e", "one"]
    poses, sockets = sets.values()
    assert poses.sizes((20, 50, 100)) == (20, 50, 60)
    rows, held_out = poses.split(50, 3)
    assert (len(rows), len(held_out)) == (50, 30)
    both = np.concatenate([rows.joint_positions, held_out.joint_positions])
    assert len(np.unique(both, axis=0)) == 80
    rows, held_out = sockets.split(0, 0)
    assert (len(rows), len(held_out), sockets.placements) == (20, 20, 2)
    assert rows.distances == ((0, 1, 0.05),)


def test_what_was_measured_is_not_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [str(written(tmp_path / "data")), "--methods", "nominal,geometry", "--splits", "1"]
    arguments += ["--sizes", "50", "--out", str(tmp_path / "out")]
    first = CliRunner().invoke(calibrate, arguments)
    assert first.exit_code == 0, first.output
    page = (tmp_path / "out" / "calibrate.md").read_text(encoding="utf-8")
    assert (tmp_path / "out" / "calibrate.png").read_bytes().startswith(b"\x89PNG")
    monkeypatch.setattr(methods, "fit_poses", None)
    monkeypatch.setattr(methods, "fit_sockets", None)
    assert CliRunner().invoke(calibrate, arguments).exit_code == 0
    again = (tmp_path / "out" / "calibrate.md").read_text(encoding="utf-8")
    tables = [
        [line for line in text.splitlines() if line.startswith("|")] for text in (page, again)
    ]
    assert tables[0] == tables[1]
    assert len(tables[0]) == 6


def test_without_measurements_nothing_is_compared(tmp_path: Path) -> None:
    result = CliRunner().invoke(calibrate, [str(tmp_path)])
    assert result.exit_code == 0
    assert "no measurements" in result.output
