"""Whole calibrations in unknown frames, and with a ball in sockets. ROS-free.

Whatever is wrong with the measurements: they are refused, or the calibrated robot is not ten times
further from the true one than its bound says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.imperfect_ur5e import (
    NOISE,
    ImperfectUr5e,
    measured,
    noisy,
    poses_of,
    touching,
)

from annik_core.errors import AnnikError
from annik_core.robots.library import load_robot
from annik_training.calibration.calibrate import CalibratedRobot, CalibrationOptions, calibrate
from annik_training.calibration.errors import (
    DegenerateExamples,
    NotCalibrated,
    NotHeldOut,
    OtherDistance,
)
from annik_training.calibration.measurements import KnownDistance, Measurements
from annik_training.calibration.model import Part
from annik_training.calibration.validation import check_rows

UR5E = load_robot("ur5e")
#: Without errors of the gears, so that the simplest model explains it.
TRUTH = replace(ImperfectUr5e.drawn(1), amplitudes=np.zeros(6))
QUICK = CalibrationOptions(candidates=(frozenset({Part.GEOMETRY}),))
#: Of the instrument and of the tool: metres, decimetres and half turns away.
BASE, TOOL = np.eye(4), np.eye(4)
BASE[:3, :3], BASE[:3, 3] = Rotation.from_rotvec([0.0, np.pi, 0.1]).as_matrix(), [4.0, -7.0, 2.0]
TOOL[:3, :3], TOOL[:3, 3] = Rotation.from_rotvec([0.0, np.pi / 2, 0.0]).as_matrix(), [0.1, 0, 0.2]
#: Two sockets, 50 mm apart, at each of three places.
PLACES = np.array([[0.4, 0.1, 0.2], [-0.3, 0.4, 0.3], [0.1, -0.5, 0.4]])
POINTS = np.repeat(PLACES, 2, axis=0) + np.tile([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]], (3, 1))
ELSEWHERE = UR5E.joint_box.sample(300, np.random.default_rng(5))


def in_frames(base: np.ndarray = BASE, tool: np.ndarray = TOOL, **known: bool) -> Measurements:
    """40 poses of a tool by an instrument somewhere."""
    joint_positions = UR5E.joint_box.sample(40, np.random.default_rng(3))
    seen = noisy(
        poses_of(base @ TRUTH.matrices(joint_positions) @ tool), NOISE, np.random.default_rng(0)
    )
    turns = Rotation.from_quat(seen[:, 3:]).as_matrix()
    return Measurements(joint_positions, seen[:, :3], turns, **known)


@lru_cache
def touching_rows() -> np.ndarray:
    """25 rows at each point."""
    parts = [touching(TRUTH, TOOL[:3, 3], point, 25, seed) for seed, point in enumerate(POINTS)]
    return np.concatenate(parts)


def in_sockets(distance: float | None = 0.05, unit: float = 1.0) -> Measurements:
    """25 rows with the tool point in each socket, but for tens of micrometres."""
    rows = touching_rows() + np.random.default_rng(2).normal(0.0, 3e-5, (150, 6))
    pairs = ((0, 1), (2, 3), (4, 5))
    distances = [KnownDistance(*pair, distance) for pair in pairs] if distance else []
    numbers = np.repeat(np.arange(6), 25)
    return Measurements(unit * rows, fixed_points=numbers, distances=distances)


def errors_over_bounds(
    found: CalibratedRobot, base: np.ndarray = BASE, tool: np.ndarray = TOOL
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the tool's position elsewhere, of sockets after the best motion, and bounds."""
    model = found.robot.forward_kinematics.poses(ELSEWHERE)
    turns = Rotation.from_quat(model[:, 3:])
    where = model[:, :3] + turns.apply(found.frames.tool[:3, 3])
    truth = (TRUTH.matrices(ELSEWHERE) @ tool)[:, :3, 3]
    if found.estimate.observations.fixed_points is None:
        where = where @ found.frames.base[:3, :3].T + found.frames.base[:3, 3]
        truth = truth @ base[:3, :3].T + base[:3, 3]
    else:
        centres = where.mean(axis=0), truth.mean(axis=0)
        turn = Rotation.align_vectors(truth - centres[1], where - centres[0])[0]
        where = turn.apply(where - centres[0]) + centres[1]
    assert found.robot.error_bound is not None
    return np.linalg.norm(where - truth, axis=1), found.robot.error_bound.of_rows(ELSEWHERE)[:, 0]


@pytest.mark.parametrize("has_rotations", [True, False])
def test_in_frames_that_are_unknown(has_rotations: bool) -> None:
    measurements = in_frames()
    if not has_rotations:
        measurements = replace(measurements, rotations=None)
    errors, bounds = errors_over_bounds(calibrate(UR5E, measurements, QUICK))
    assert errors.mean() < 5e-5
    assert (errors <= bounds).mean() > 0.9
    assert bounds.mean() < 10.0 * errors.mean()


def test_a_dataset_with_another_tool_is_of_that_tool() -> None:
    """Its robot is the model, with all its parts, at the tool."""
    joint_positions = UR5E.joint_box.sample(60, np.random.default_rng(3))
    bent = replace(TRUTH, sag=6e-4)
    poses = noisy(poses_of(bent.matrices(joint_positions) @ TOOL), NOISE, np.random.default_rng(0))
    dataset = measured(UR5E, lambda _: poses, joint_positions, noise=(0.0, 0.0), stated=NOISE)
    rigid = frozenset({Part.GEOMETRY})
    options = CalibrationOptions(candidates=(rigid, rigid | {Part.POSE_SERIES}))
    found = calibrate(UR5E, dataset, options)
    model, estimate = found.estimate.model, found.estimate
    assert Part.POSE_SERIES in model.parts
    positions, turns = model.positions_and_rotations(estimate.model_parameters, ELSEWHERE)
    expected = positions + turns @ found.frames.tool[:3, 3]
    reached = found.robot.forward_kinematics.poses(ELSEWHERE)
    assert np.abs(reached[:, :3] - expected).max() < 1e-7
    turned = Rotation.from_matrix(turns @ found.frames.tool[:3, :3])
    assert (turned.inv() * Rotation.from_quat(reached[:, 3:])).magnitude().max() < 1e-7


def test_other_rows_check_it() -> None:
    measurements = in_frames()
    kept, others = measurements.where(np.arange(40) < 30), measurements.where(np.arange(40) >= 30)
    found = calibrate(UR5E, kept, QUICK)
    checked = check_rows(found.robot, found.frames, kept.joint_positions, others)
    assert checked.angles is not None
    assert checked.distances.mean() < 2e-4
    assert checked.angles.mean() < 1e-3
    assert checked.bounds.shape == (10, 2)
    alone = replace(others, rotations=None)
    again = check_rows(found.robot, found.frames, kept.joint_positions, alone)
    assert again.angles is None
    assert np.array_equal(again.distances, checked.distances)
    with pytest.raises(NotHeldOut):
        check_rows(found.robot, found.frames, measurements.joint_positions, others)
    with pytest.raises(NotCalibrated):
        check_rows(UR5E, found.frames, kept.joint_positions, others)


@pytest.fixture(scope="module")
def socketed() -> CalibratedRobot:
    return calibrate(UR5E, in_sockets(), QUICK)


def test_with_a_ball_in_sockets(socketed: CalibratedRobot) -> None:
    errors, bounds = errors_over_bounds(socketed)
    assert errors.mean() < 1e-4
    assert (errors <= bounds).mean() > 0.9
    assert bounds.mean() < 10.0 * errors.mean()
    for one in socketed.distances:
        assert one.found == pytest.approx(0.05, abs=4.0 * one.deviation)
        assert not one.is_doubtful


def test_another_placement_checks_it(socketed: CalibratedRobot) -> None:
    """By the distances of the tool point from where it is on average."""
    point = np.array([0.35, -0.2, 0.15])
    rows = touching(TRUTH, TOOL[:3, 3], point, 15, 9)
    numbers = np.arange(len(rows)) // 8
    used = socketed.measured.joint_positions
    checked = check_rows(
        socketed.robot, socketed.frames, used, Measurements(rows, fixed_points=numbers)
    )
    assert checked.angles is None
    assert checked.distances.mean() < 2e-4


@pytest.mark.parametrize("distance", [50.0, 0.5, 5e-5, 0.04])
def test_another_distance_of_the_sockets_is_refused(distance: float) -> None:
    """In another unit, or of another base."""
    with pytest.raises(OtherDistance) as caught:
        calibrate(UR5E, in_sockets(distance), QUICK)
    assert caught.value.known == distance
    assert caught.value.found == pytest.approx(0.05, abs=2e-3)


def test_one_distance_of_another_base_is_not_used() -> None:
    """As after a base was moved between its two sockets."""
    measurements = in_sockets()
    *others, last = measurements.distances
    found = calibrate(
        UR5E, replace(measurements, distances=[*others, last._replace(metres=0.06)]), QUICK
    )
    assert [one.is_another for one in found.distances] == [False, False, True]
    errors, bounds = errors_over_bounds(found)
    assert errors.mean() < 1.5e-4
    assert (errors <= bounds).mean() > 0.9


@pytest.mark.parametrize("distance", [0.05, None])
def test_an_arm_does_not_shrink_to_fit_many_rows(distance: float | None) -> None:
    """Without any length it would fit fixed points best."""
    parts = [touching(TRUTH, TOOL[:3, 3], point, 120, seed) for seed, point in enumerate(POINTS)]
    rows = np.concatenate(parts)
    numbers = np.repeat(np.arange(6), [len(part) for part in parts])
    rows += np.random.default_rng(2).normal(0.0, 3e-4, rows.shape)
    pairs = ((0, 1), (2, 3), (4, 5)) if distance else ()
    distances = [KnownDistance(*pair, 0.05) for pair in pairs]
    found = calibrate(UR5E, Measurements(rows, fixed_points=numbers, distances=distances), QUICK)
    assert found.estimate.noise.position > 5e-5
    points = found.frames.points
    for first, second in ((0, 2), (2, 4), (1, 5)):
        true = float(np.linalg.norm(POINTS[first] - POINTS[second]))
        assert np.linalg.norm(points[first] - points[second]) == pytest.approx(true, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("each", [3, 10])
def test_a_pose_that_was_measured_again_tells_nothing_of_others(each: int) -> None:
    """The bound holds all the same, with errors of the gears that 40 poses don't show."""
    rng = np.random.default_rng(0)
    truth = ImperfectUr5e.drawn(1)
    joint_positions = np.repeat(UR5E.joint_box.sample(40, np.random.default_rng(3)), each, axis=0)
    joint_positions += rng.normal(0.0, 1e-3, joint_positions.shape)
    positions = truth.matrices(joint_positions)[:, :3, 3] + rng.normal(0.0, 2e-5, (40 * each, 3))
    found = calibrate(UR5E, Measurements(joint_positions, positions))
    model = found.robot.forward_kinematics.poses(ELSEWHERE)
    where = model[:, :3] + Rotation.from_quat(model[:, 3:]).apply(found.frames.tool[:3, 3])
    where = where @ found.frames.base[:3, :3].T + found.frames.base[:3, 3]
    errors = np.linalg.norm(where - truth.matrices(ELSEWHERE)[:, :3, 3], axis=1)
    assert found.robot.error_bound is not None
    assert (errors <= found.robot.error_bound.of_rows(ELSEWHERE)[:, 0]).mean() > 0.9


def test_sockets_with_a_joint_that_does_not_move() -> None:
    measurements = in_sockets()
    rows = measurements.joint_positions.copy()
    rows[:, 5] = 0.3
    with pytest.raises(DegenerateExamples) as caught:
        calibrate(UR5E, replace(measurements, joint_positions=rows), QUICK)
    assert caught.value.joints == ("wrist_3_joint",)


def test_a_distance_that_is_a_little_wrong_is_doubtful() -> None:
    found = calibrate(UR5E, in_sockets(0.048), QUICK)
    assert all(one.is_doubtful for one in found.distances)


def shifted(measurements: Measurements) -> Measurements:
    """A tracker that was moved for the last rows."""
    assert measurements.positions is not None
    positions = measurements.positions.copy()
    positions[30:] += [0.0, 0.005, 0.0]
    return replace(measurements, positions=positions)


def shuffled(measurements: Measurements) -> Measurements:
    order = np.random.default_rng(0).permutation(len(measurements))
    return replace(measurements, joint_positions=measurements.joint_positions[order])


@pytest.mark.parametrize(
    "measurements",
    [
        lambda: in_frames(tool_known=True),
        lambda: in_frames(np.eye(4), frame_known=True, tool_known=True),
        lambda: in_frames(frame_known=True),
        lambda: shifted(in_frames()),
        lambda: shuffled(in_frames()),
        lambda: replace(in_frames(), positions=1e3 * in_frames().positions),
        lambda: replace(in_frames(), rotations=in_frames().rotations.swapaxes(1, 2)),
        lambda: replace(in_frames(), joint_positions=-in_frames().joint_positions),
        lambda: shuffled(in_sockets()),
        lambda: in_sockets(None),
        lambda: in_sockets(unit=-1.0),
        lambda: in_sockets(None, unit=-1.0),
        lambda: shuffled(in_sockets(None)),
        lambda: in_sockets(unit=1.02),
    ],
)
def test_what_is_wrong_is_refused_or_within_ten_bounds(
    measurements: Callable[[], Measurements],
) -> None:
    try:
        found = calibrate(UR5E, measurements(), QUICK)
    except AnnikError:
        return
    errors, bounds = errors_over_bounds(found)
    assert (errors <= 10.0 * bounds).all()
