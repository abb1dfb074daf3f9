"""Unknown frames of a measurement: the base, the tool, and fixed points. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.imperfect_ur5e import PERFECT, ImperfectUr5e, touching

from annik_core.robots.library import load_robot
from annik_training.calibration.errors import OtherFrame
from annik_training.calibration.frames import Frames, check_known, initial_frames
from annik_training.calibration.measurements import KnownDistance, Measurements
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise, Observations

UR5E = load_robot("ur5e")
TOOL = np.array([0.08, -0.15, 0.21])
TOOL_TURN = Rotation.from_rotvec([2.0, -1.0, 1.5])
#: Half a turn about each axis, about none, and about any.
TURNS = [[0, 0, 0], [np.pi, 0, 0], [0, np.pi, 0], [0, 0, np.pi], [1.0, -2.0, 0.5]]
ABOUT = [Rotation.from_rotvec(turn) for turn in TURNS]
SHIFT = np.array([4.0, -7.0, 2.0])


def in_a_frame(truth: ImperfectUr5e, turn: Rotation, count: int, **known: bool) -> Measurements:
    """Poses of a tool, by an instrument some metres away that is turned."""
    joint_positions = UR5E.joint_box.sample(count, np.random.default_rng(3))
    poses = truth.matrices(joint_positions)
    points, turns = poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3])
    if not known.get("tool_known"):
        points, turns = points + turns.apply(TOOL), turns * TOOL_TURN
    if not known.get("frame_known"):
        points, turns = turn.apply(points) + SHIFT, turn * turns
    return Measurements(joint_positions, points, turns.as_matrix(), **known)


def nominal(measurements: Measurements) -> tuple[np.ndarray, np.ndarray]:
    poses = PERFECT.matrices(measurements.joint_positions)
    return poses[:, :3, 3], poses[:, :3, :3]


@pytest.mark.parametrize("turn", ABOUT)
@pytest.mark.parametrize("has_rotations", [True, False])
@pytest.mark.parametrize("known", [{}, {"frame_known": True}, {"tool_known": True}])
def test_frames_are_found_from_anywhere(
    turn: Rotation, has_rotations: bool, known: dict[str, bool]
) -> None:
    measurements = in_a_frame(PERFECT, turn, 25, **known)
    if not has_rotations:
        measurements = replace(measurements, rotations=None)
    found = initial_frames(measurements, *nominal(measurements))
    base, tool = np.eye(4), np.eye(4)
    if not known.get("frame_known"):
        base[:3, :3], base[:3, 3] = turn.as_matrix(), SHIFT
    if not known.get("tool_known"):
        tool[:3, 3] = TOOL
        tool[:3, :3] = TOOL_TURN.as_matrix() if has_rotations else np.eye(3)
    assert found.base == pytest.approx(base, abs=1e-8)
    assert found.tool == pytest.approx(tool, abs=1e-8)


def test_gross_errors_move_no_frame() -> None:
    measurements = in_a_frame(PERFECT, ABOUT[-1], 40)
    assert measurements.positions is not None
    positions = measurements.positions.copy()
    positions[::10] += [0.3, 0.0, -0.2]
    found = initial_frames(replace(measurements, positions=positions), *nominal(measurements))
    assert found.base[:3, 3] == pytest.approx(SHIFT, abs=2e-3)
    assert found.tool[:3, 3] == pytest.approx(TOOL, abs=2e-3)


#: Fixed points of three placements, two 50 mm apart each.
PLACES = np.array([[0.4, 0.1, 0.2], [-0.3, 0.4, 0.3], [0.1, -0.5, 0.4]])
POINTS = np.repeat(PLACES, 2, axis=0) + np.tile([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]], (3, 1))


def at_points(truth: ImperfectUr5e, rows: int, numbers: list[int]) -> Measurements:
    """The tool point at some of the fixed points, which have any numbers."""
    parts = [touching(truth, TOOL, point, rows, seed) for seed, point in enumerate(POINTS)]
    distances = [KnownDistance(*numbers[at : at + 2], 0.05) for at in (0, 2, 4)]
    return Measurements(
        np.concatenate(parts),
        fixed_points=np.repeat(numbers, rows),
        distances=distances,
    )


def test_fixed_points_and_the_tool_point_are_found() -> None:
    """Whatever numbers the points have."""
    numbers = [40, 7, 12, 3, 90, 91]
    measurements = at_points(PERFECT, 8, numbers)
    found = initial_frames(measurements, *nominal(measurements))
    assert found.tool[:3, 3] == pytest.approx(TOOL, abs=1e-8)
    assert found.points == pytest.approx(POINTS[np.argsort(numbers)], abs=1e-8)


def test_three_placements_are_left_out_whole_and_of_two_thirds_of_a_point() -> None:
    measurements = at_points(PERFECT, 9, list(range(6)))
    frames = initial_frames(measurements, *nominal(measurements))
    three = replace(Observations.of(measurements), frames=frames)
    assert three.leaves_placements_out
    assert three.folds.tolist() == np.arange(3).repeat(18).tolist()
    two = three.where(three.folds < 2)
    assert not two.leaves_placements_out
    thirds = two.folds.reshape(-1, 3)
    assert (thirds == thirds[:, :1]).all()
    assert len(np.unique(two.folds)) == 10


def test_derivatives_by_the_frames_are_finite_differences() -> None:
    model = ParametricModel(UR5E, frozenset({Part.GEOMETRY}))
    poses = in_a_frame(PERFECT, ABOUT[-1], 6)
    points = at_points(PERFECT, 2, list(range(6)))
    for measurements in (poses, replace(poses, rotations=None), points):
        frames = initial_frames(measurements, *nominal(measurements))
        observations = replace(Observations.of(measurements), frames=frames)
        evaluated = model.evaluate(np.zeros(model.size), measurements.joint_positions)
        where = evaluated.positions, evaluated.rotations
        noise = Noise(1e-2, 2e-2)
        here = observations.derivatives(evaluated, noise)[:, :, model.size :]
        distances = observations.distance_derivatives(np.zeros(frames.size))
        for index, step in enumerate(1e-6 * np.eye(frames.size)):
            before, after = (
                observations.residuals(*where, noise, sign * step) for sign in (-1, 1)
            )
            assert here[:, :, index] == pytest.approx((after - before) / 2e-6, abs=1e-4)
            before, after = (observations.distance_residuals(sign * step) for sign in (-1, 1))
            assert distances[:, index] == pytest.approx(
                (after - before) / 2e-6, rel=1e-3, abs=1e-2
            )


def moved(measurements: Measurements, turn: Rotation, shift: list[float]) -> Measurements:
    assert measurements.positions is not None
    positions = turn.apply(measurements.positions) + shift
    return replace(
        measurements, positions=positions, rotations=turn.as_matrix() @ measurements.rotations
    )


@pytest.mark.parametrize(
    ("turn", "shift", "name"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.05, 0.0], "base"),
        ([0.17, 0.0, 0.0], [0.0, 0.0, 0.0], "base"),
        ([0.0, 0.0, 0.0], [0.0, 0.015, 0.0], None),
        ([0.03, 0.0, 0.0], [0.0, 0.0, 0.0], None),
    ],
)
def test_a_frame_that_is_not_the_known_one_is_named(
    turn: list[float], shift: list[float], name: str | None
) -> None:
    """Where the robot's base is off by more than an arm's errors; no joint is blamed."""
    measurements = in_a_frame(
        ImperfectUr5e.drawn(1), ABOUT[0], 30, frame_known=True, tool_known=True
    )
    measurements = moved(measurements, Rotation.from_rotvec(turn), shift)
    frames = initial_frames(measurements, *nominal(measurements))
    if name is None:
        check_known(measurements, frames, *nominal(measurements))
        return
    with pytest.raises(OtherFrame) as caught:
        check_known(measurements, frames, *nominal(measurements))
    assert caught.value.name == name
    assert caught.value.distance == pytest.approx(np.linalg.norm(shift), abs=0.02)
    assert caught.value.angle == pytest.approx(np.linalg.norm(turn), abs=0.02)


def test_a_tool_that_is_not_the_known_one_is_named() -> None:
    measurements = in_a_frame(ImperfectUr5e.drawn(1), ABOUT[0], 30, frame_known=True)
    measurements = replace(measurements, tool_known=True)
    with pytest.raises(OtherFrame) as caught:
        check_known(measurements, Frames.known(), *nominal(measurements))
    assert caught.value.name == "tool"
    assert caught.value.distance == pytest.approx(np.linalg.norm(TOOL), abs=0.02)
