"""How far off the nominal and the learned model are from poses measured on the robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.calibration.errors import MeasuredFitError
from annik_training.calibration.observations import is_measured_alike

#: Into how many regions the box of each joint is divided.
REGIONS = 3
#: Length that 95 of 100 vectors of three independent coordinates stay below, in their standard
#: deviations.
_NOISE_BOUND = 2.795


class NotHeldOut(MeasuredFitError):
    """The model was learned from these very examples."""

    def __init__(self, examples: int) -> None:
        super().__init__(
            f"the model was learned from these {examples} examples, so they say nothing of how "
            "well: measure others, such as those of another --seed"
        )


class NotLearned(MeasuredFitError):
    """The model was not learned from measured poses."""

    def __init__(self, name: str) -> None:
        super().__init__(
            f"the model is for {name} as described, not as measured: there is no before and "
            "after; annik fit makes one that is learned"
        )


class OtherRobotMeasured(MeasuredFitError):
    """The poses were measured on another robot, or between other frames, than the model's."""

    def __init__(self, measured: str, model: str) -> None:
        super().__init__(f"the poses were measured on {measured}, the model is for {model}")


@dataclass(frozen=True, eq=False)
class MeasuredErrors:
    """Errors of a model at measured poses, one per example.

    A command of the inverse kinematics for the measured pose would miss it by as much.

    Attributes:
        distances: ``(n,)`` [m].
        angles: ``(n,)`` [rad].
    """

    distances: FloatArray
    angles: FloatArray

    def rows(self, keep: Any) -> MeasuredErrors:
        """Those where ``keep`` ``(n,)`` is true."""
        return MeasuredErrors(self.distances[keep], self.angles[keep])


class Region(NamedTuple):
    """A part of the working box, by the position of one joint.

    Attributes:
        joint: its name.
        lower: where it begins [rad or m].
        upper: where it ends.
        examples: how many are there.
        before: mean distance by the nominal model [m]; NaN without examples.
        after: by the learned one.
    """

    joint: str
    lower: float
    upper: float
    examples: int
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class MeasuredEvaluation:
    """Before and after, on held-out poses.

    Attributes:
        dataset: the held-out poses.
        before: errors of the nominal model.
        after: errors of the learned one.
        bounds: ``(n, 2)`` distance [m] and angle [rad] that the model states for 95 of 100 poses.
        regions: mean errors by joint and part of its box.
        has_orientation: whether orientations were learned; if not, the angles mean nothing.
    """

    dataset: Dataset
    before: MeasuredErrors
    after: MeasuredErrors
    bounds: FloatArray
    regions: tuple[Region, ...]
    has_orientation: bool

    @property
    def bounds_of_measurements(self) -> FloatArray:
        """``(n, 2)``: the bounds, widened by the noise of the measurements if it is known."""
        noise = np.array(self.dataset.measurement_noise or (0.0, 0.0))
        return np.asarray(np.hypot(self.bounds, _NOISE_BOUND * noise), dtype=np.float64)

    @property
    def within_bounds(self) -> tuple[float, float]:
        """Part of the measured distances and angles that are within these bounds."""
        errors = np.stack([self.after.distances, self.after.angles], axis=1)
        position, orientation = (errors <= self.bounds_of_measurements).mean(axis=0).tolist()
        return position, orientation


def evaluate_measured(robot: Robot, dataset: Dataset) -> MeasuredEvaluation:
    """Compare what a learned robot's definition says with poses measured on the robot.

    Args:
        robot: the learned one, as its model file carries it.
        dataset: measured poses that it was not learned from.

    Raises:
        NotLearned: if it was not learned from measured poses.
        NotHeldOut: if it was learned from these.
        OtherRobotMeasured: if the robot that they were measured on has other joints or frames.
    """
    corrections = robot.definition.get("corrections")
    if corrections is None or robot.error_bound is None:
        raise NotLearned(robot.name)
    provenance = corrections.get("provenance", {})
    if provenance.get("measurements_hash") == dataset.measurements_hash:
        raise NotHeldOut(len(dataset))
    nominal = robot_from_definition(robot.nominal_definition, robot.name)
    if not is_measured_alike(dataset.robot, nominal):
        raise OtherRobotMeasured(dataset.robot.name, robot.name)
    before, after = _errors(nominal, dataset), _errors(robot, dataset)
    bounds = np.array([robot.error_bound.at(row) for row in dataset.joint_positions])
    regions = tuple(_regions(dataset, before, after))
    has_orientation = provenance.get("position_only") is not True
    return MeasuredEvaluation(dataset, before, after, bounds, regions, has_orientation)


def _errors(robot: Robot, dataset: Dataset) -> MeasuredErrors:
    poses = robot.forward_kinematics.poses(dataset.joint_positions)
    return MeasuredErrors(*pose_distance(dataset.poses, poses))


def _regions(dataset: Dataset, before: MeasuredErrors, after: MeasuredErrors) -> Iterator[Region]:
    box = dataset.robot.joint_box
    for index in box.free.tolist():
        edges = np.linspace(box.lower[index], box.upper[index], REGIONS + 1)
        part = np.digitize(dataset.joint_positions[:, index], edges[1:-1])
        for region in range(REGIONS):
            inside = part == region
            means = [
                float(errors.rows(inside).distances.mean()) if inside.any() else float("nan")
                for errors in (before, after)
            ]
            yield Region(
                box.joint_names[index],
                float(edges[region]),
                float(edges[region + 1]),
                int(inside.sum()),
                *means,
            )
