"""Paths inside the joint box of a robot. Needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from annik_core.errors import InvalidValue
from annik_core.installation import packaged_models
from annik_core.pose import pose_from_roll_pitch_yaw
from annik_core.reachable_paths import reachable_path, start_positions
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.safety import CommandSafety, IkStatus, Refusal
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.result import IkResult
from annik_core.target_paths import PathKind, TargetPath, diagonal_path

LARGEST_STEP = CommandSafety().max_first_step
MADE = [kind for kind in PathKind if kind is not PathKind.CSV]


@pytest.mark.parametrize("kind", MADE)
@pytest.mark.parametrize("name", packaged_models())
def test_every_packaged_robot_follows_every_path_from_where_it_starts(
    name: str, kind: PathKind
) -> None:
    """Each pose is solved, the first near the start, and no solution jumps."""
    solver = IkSolver.from_file(name)
    poses = reachable_path(TargetPath(path=kind, points=141), solver)
    assert poses.shape == (141, 7)
    results = [solver.solve(pose) for pose in poses]
    assert [result.status for result in results] == [IkStatus.SUCCESS] * 141
    positions = np.array([result.joint_positions for result in results])
    assert np.abs(positions[0] - start_positions(solver.robot)).max() < LARGEST_STEP
    assert np.abs(np.diff(positions, axis=0)).max() < 0.05
    assert np.ptp(poses[:, :3], axis=0).max() > 0.05


@pytest.mark.parametrize("kind", MADE)
def test_the_gantrys_paths_are_those_of_their_numbers(kind: PathKind) -> None:
    path = TargetPath(path=kind, points=141)
    poses = reachable_path(path, IkSolver.from_file("gantry"))
    assert np.array_equal(poses, path.poses())
    if kind is PathKind.DIAGONAL:
        assert np.array_equal(poses, diagonal_path(141))


def test_the_gantry_starts_near_the_papers_path_and_near_the_centre() -> None:
    robot = load_robot("gantry")
    solver = IkSolver.from_file("gantry")
    start = start_positions(robot)
    first = solver.solve(diagonal_path()[0]).joint_positions
    assert first is not None
    for positions in (first, robot.joint_box.centre):
        assert np.abs(positions - start).max() < LARGEST_STEP


def test_numbers_that_were_given_are_kept() -> None:
    solver = IkSolver.from_file("ur5e")
    free = reachable_path(TargetPath(path=PathKind.LINE), solver)
    end = tuple((free[0, :3] + [0.0, 0.05, -0.05]).tolist())
    path = TargetPath(path=PathKind.LINE, line_to_position=end, points=7)
    poses = reachable_path(path, solver)
    np.testing.assert_allclose(poses[0], free[0], atol=1e-12)
    np.testing.assert_allclose(poses[-1, :3], end, atol=1e-12)
    assert all(solver.solve(pose).accepted for pose in poses)
    circle = TargetPath(path=PathKind.CIRCLE, circle_radius=0.02)
    assert np.ptp(reachable_path(circle, solver)[:, 0]) < 0.0401


def test_targets_of_a_file_are_taken_as_they_are(tmp_path) -> None:
    far = pose_from_roll_pitch_yaw([9.0, 9.0, 9.0], [0.0, 0.0, 0.0])
    file = tmp_path / "targets.csv"
    file.write_text("x,y,z,qx,qy,qz,qw\n" + ",".join(map(str, far)), encoding="utf-8")
    path = TargetPath(path=PathKind.CSV, csv_file=str(file))
    np.testing.assert_array_equal(reachable_path(path, IkSolver.from_file("ur5e")), [far])


@dataclass
class Refuses:
    """A solver that refuses every pose beyond a distance from the first one."""

    robot: Robot
    radius: float
    first: np.ndarray | None = None

    def solve(self, pose: np.ndarray, previous: np.ndarray) -> IkResult:
        if self.first is None:
            self.first = pose
        if np.linalg.norm(pose[:3] - self.first[:3]) <= self.radius:
            return IkResult(IkStatus.SUCCESS, start_positions(self.robot), 0.0, 0.0, 0, "", pose)
        return IkResult.refused(Refusal(IkStatus.NOT_CONVERGED, "test"))


@pytest.mark.parametrize("kind", MADE)
def test_a_path_that_can_not_be_followed_is_refused(kind: PathKind) -> None:
    """A robot with few joints can't keep its orientation on a line."""
    with pytest.raises(InvalidValue) as error:
        reachable_path(TargetPath(path=kind), Refuses(load_robot("ur5e"), -1.0))
    assert (error.value.name, error.value.value) == ("path", kind.value)


def test_a_path_is_as_large_as_the_robot_can_follow() -> None:
    robot = load_robot("ur5e")
    pose = robot.forward_kinematics.poses(start_positions(robot)[None])[0]
    solver = Refuses(robot, 0.06, pose)
    line = reachable_path(TargetPath(path=PathKind.LINE), solver)
    assert np.linalg.norm(line[-1, :3] - line[0, :3]) == pytest.approx(0.05)
    circle = reachable_path(TargetPath(path=PathKind.CIRCLE, points=40), solver)
    assert np.ptp(circle[:, 0]) == pytest.approx(0.05)
    assert all(solver.solve(target, circle[0]).accepted for target in circle)
