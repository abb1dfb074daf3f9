"""Errors of the nominal and the calibrated robot at held-out measured poses."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.calibration.errors import NotCalibrated, NotHeldOut
from annik_training.calibration.frames import Frames
from annik_training.calibration.measurements import Measurements
from annik_training.calibration.observations import (
    Noise,
    Observations,
    check_measured_alike,
)

#: Number of regions of each joint's interval.
REGIONS = 3
#: 95th percentile of the length of three independent standard normal coordinates.
_NOISE_BOUND = 2.795


@dataclass(frozen=True, eq=False)
class MeasuredErrors:
    """Errors of a robot's forward kinematics at measured poses, one per pose."""

    distances: FloatArray  #: ``(n,)`` [m]
    angles: FloatArray  #: ``(n,)`` [rad]


class CheckedRows(NamedTuple):
    """Errors at rows that a calibration did not use."""

    #: ``(n,)`` of positions; of fixed points the distances of the tool from its mean there [m].
    distances: FloatArray
    angles: FloatArray | None  #: ``(n,)`` [rad]; None if no orientations were measured
    bounds: FloatArray  #: ``(n, 2)`` stated 95 % bounds, distance [m] and angle [rad]


class Region(NamedTuple):
    """A part of the joint box, by the position of one joint."""

    joint: str
    lower: float  #: lower bound [rad or m]
    upper: float
    examples: int
    before: float  #: mean distance of the nominal robot [m]; NaN without poses
    after: float  #: mean distance of the calibrated robot


@dataclass(frozen=True, eq=False)
class MeasuredEvaluation:
    """Errors before and after a calibration, at held-out poses."""

    dataset: Dataset  #: the held-out poses
    before: MeasuredErrors  #: errors of the nominal robot
    after: MeasuredErrors  #: errors of the calibrated robot
    bounds: FloatArray  #: ``(n, 2)`` stated 95 % bounds, distance [m] and angle [rad]
    regions: tuple[Region, ...]  #: mean errors by joint and part of its interval
    #: Whether orientations were calibrated; if not, the angles are arbitrary.
    has_orientation: bool

    @property
    def bounds_of_measurements(self) -> FloatArray:
        """The bounds ``(n, 2)``, widened by the noise of the measurements if it is known."""
        noise = np.array(self.dataset.measurement_noise or (0.0, 0.0))
        return np.asarray(np.hypot(self.bounds, _NOISE_BOUND * noise), dtype=np.float64)

    @property
    def within_bounds(self) -> tuple[float, float]:
        """Fraction of the measured distances and angles within these bounds."""
        errors = np.stack([self.after.distances, self.after.angles], axis=1)
        position, orientation = (errors <= self.bounds_of_measurements).mean(axis=0).tolist()
        return position, orientation


def evaluate_measured(robot: Robot, dataset: Dataset) -> MeasuredEvaluation:
    """Errors of a calibrated robot, and of the nominal one, at measured poses.

    Raises:
        NotCalibrated: if it was not calibrated.
        NotHeldOut: if it was calibrated with these poses.
        RobotMismatch: if they were measured with other joints or frames.
    """
    corrections = robot.definition.get("corrections")
    if corrections is None or robot.error_bound is None:
        raise NotCalibrated(robot.name)
    provenance = corrections.get("provenance", {})
    if provenance.get("measurements_hash") == dataset.measurements_hash:
        raise NotHeldOut(len(dataset))
    nominal = robot_from_definition(robot.nominal_definition, robot.name)
    check_measured_alike(nominal, dataset.robot)
    before, after = _errors(nominal, dataset), _errors(robot, dataset)
    bounds = robot.error_bound.of_rows(robot.in_box(dataset.joint_positions))
    regions = tuple(_regions(dataset, before, after))
    has_orientation = provenance.get("position_only") is not True
    return MeasuredEvaluation(dataset, before, after, bounds, regions, has_orientation)


def check_rows(
    robot: Robot, frames: Frames, used: FloatArray, measurements: Measurements
) -> CheckedRows:
    """Errors of a calibrated robot, in the frames that were found, at other rows.

    ``used`` are the joint positions ``(m, dof)`` that it was calibrated with.

    Raises:
        NotCalibrated: if it was not calibrated.
        NotHeldOut: if it was calibrated with some of these rows.
    """
    if robot.error_bound is None:
        raise NotCalibrated(robot.name)
    joint_positions = measurements.joint_positions
    known = set(map(tuple, used.tolist()))
    repeated = sum(tuple(row) in known for row in joint_positions.tolist())
    if repeated:
        raise NotHeldOut(repeated)
    poses = robot.forward_kinematics.poses(joint_positions)
    turns = Rotation.from_quat(poses[:, 3:]).as_matrix()
    observations = Observations.of(measurements)
    touched = observations.fixed_points
    if touched is not None:
        frames = replace(frames, points=np.zeros((int(touched.max()) + 1, 3)))
    away = replace(observations, frames=frames).residuals(poses[:, :3], turns, Noise(1.0, 1.0))
    if touched is not None:
        for point in np.unique(touched):
            away[touched == point] -= away[touched == point].mean(axis=0)
    distances, angles = (np.linalg.norm(part, axis=1) for part in (away[:, :3], away[:, 3:]))
    bounds = robot.error_bound.of_rows(robot.in_box(joint_positions))
    return CheckedRows(distances, angles if observations.has_orientation else None, bounds)


def _errors(robot: Robot, dataset: Dataset) -> MeasuredErrors:
    poses = robot.forward_kinematics.poses(dataset.joint_positions)
    return MeasuredErrors(*pose_distance(dataset.poses, poses))


def _regions(dataset: Dataset, before: MeasuredErrors, after: MeasuredErrors) -> Iterator[Region]:
    box = dataset.robot.joint_box
    joint_positions = dataset.robot.in_box(dataset.joint_positions)
    for index in box.free.tolist():
        edges = np.linspace(box.lower[index], box.upper[index], REGIONS + 1)
        part = np.digitize(joint_positions[:, index], edges[1:-1])
        for region in range(REGIONS):
            inside = part == region
            means = [
                float(errors.distances[inside].mean()) if inside.any() else float("nan")
                for errors in (before, after)
            ]
            yield Region(
                box.joint_names[index],
                float(edges[region]),
                float(edges[region + 1]),
                int(inside.sum()),
                *means,
            )
