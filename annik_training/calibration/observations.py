"""Measured poses, their noise, and the residuals of a model."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from annik_core.dataset import Dataset
from annik_core.errors import RobotMismatch
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_training.calibration.frames import Frames
from annik_training.calibration.measurements import KnownDistance, Measurements
from annik_training.calibration.model import Evaluated

#: Number of parts of the rows that are left out in turn.
_FOLDS = 10
#: Rows that are nearer in joint space have nearly the same errors [rad or m].
_SAME_PLACE = 0.3
#: Unless they are more than this part of all.
_MOST = 0.3
#: Least number of placements in a fit that judges a model.
_LEFT = 2
#: Least standard deviation of the noise [m], [rad]: an ideal robot's measurements have none, but
#: no socket holds a ball better than by some micrometres.
_LEAST_NOISE, _LEAST_NOISE_OF_POINTS = 1e-7, 1e-5
#: Degrees of freedom of the noise before they are found.
NOISE_DEGREES = 4.0
#: Standard deviation of a known distance between fixed points [m].
DISTANCE_SIGMA = 5e-5


def check_measured_alike(robot: Robot, measured: Robot) -> None:
    """Raise RobotMismatch if poses were measured on a robot with other joints or frames."""
    expected, found = (
        f"({', '.join(one.joint_names)}; {one.base_frame} to {one.end_effector_frame})"
        for one in (robot, measured)
    )
    if expected != found:
        raise RobotMismatch(
            "the measured dataset", f"{robot.name} {expected}", f"{measured.name} {found}"
        )


@dataclass(frozen=True)
class Noise:
    """Standard deviations of a measured pose."""

    position: float  #: of each coordinate [m]
    orientation: float  #: of each component of the rotation vector [rad]


@dataclass(frozen=True, eq=False)
class Observations:
    """Joint positions as commanded and poses as measured."""

    #: ``(n, dof)`` [rad or m], continuous joints in the turn around their box.
    joint_positions: FloatArray
    positions: FloatArray  #: ``(n, 3)`` [m]
    rotations: FloatArray  #: ``(n, 3, 3)``
    has_orientation: bool  #: whether the rotations were measured; if not, they are arbitrary
    weights: FloatArray  #: ``(n,)`` weight of each example, 0 to 1

    #: So many rows tell as much as one: what a model leaves of neighbours may resemble each other.
    redundancy: float = 1.0
    #: Degrees of freedom of the noise, which has Student's distribution.
    noise_degrees: float = NOISE_DEGREES
    frames: Frames = field(default_factory=Frames.known)
    #: ``(n,)`` row of ``frames.points`` that is touched; None if positions were measured.
    fixed_points: NDArray[np.int64] | None = None
    #: Known distances between rows of ``frames.points``.
    distances: tuple[KnownDistance, ...] = ()

    @classmethod
    def of(
        cls, measured: Dataset | Measurements, *, position_only: bool = False
    ) -> "Observations":
        """All examples, with full weight, and frames that are known.

        Raises:
            NonFiniteValue: naming the first row with a number that is not finite.
        """
        if isinstance(measured, Dataset):
            measurements = Measurements.of(measured, position_only=position_only)
            joint_positions = measured.robot.in_box(measured.joint_positions)
            measurements = replace(measurements, joint_positions=joint_positions)
        else:
            measurements = measured
            if position_only:
                measurements = replace(measured, rotations=None)
        count = len(measurements)
        positions, rotations = measurements.positions, measurements.rotations
        index, distances = None, []
        if measurements.fixed_points is not None:
            numbers, index = measurements.touched
            places = {int(number): place for place, number in enumerate(numbers)}
            distances = [
                KnownDistance(places[first], places[second], metres)
                for first, second, metres in measurements.distances
            ]
        return cls(
            measurements.joint_positions,
            np.zeros((count, 3)) if positions is None else positions,
            np.tile(np.eye(3), (count, 1, 1)) if rotations is None else rotations,
            rotations is not None,
            np.ones(count),
            fixed_points=index,
            distances=tuple(distances),
        )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def rows(self) -> int:
        """Measured numbers per example."""
        return 6 if self.has_orientation else 3

    @property
    def has_length(self) -> bool:
        """Whether any length was measured: positions, or distances between fixed points."""
        return self.fixed_points is None or bool(self.distances)

    @property
    def least_noise(self) -> float:
        """Least standard deviation of the noise [m], [rad]."""
        return _LEAST_NOISE if self.fixed_points is None else _LEAST_NOISE_OF_POINTS

    @property
    def information(self) -> FloatArray:
        """``(n,)`` weight of each example in a fit."""
        return self.weights / self.redundancy

    @cached_property
    def placements(self) -> NDArray[np.int64] | None:
        """``(n,)`` number of each example's placement: points with known distances are one."""
        if self.fixed_points is None:
            return None
        of_point = np.arange(len(self.frames.points))
        for first, second, _ in self.distances:
            of_point[of_point == of_point[second]] = of_point[first]
        return np.unique(of_point[self.fixed_points], return_inverse=True)[1]

    @property
    def leaves_placements_out(self) -> bool:
        """Whether folds are placements: without one, two or more must be left."""
        return self.placements is not None and int(self.placements.max()) >= _LEFT

    @cached_property
    def folds(self) -> NDArray[np.int64]:
        """``(n,)`` number of the fold with which each row is left out of a fit.

        At random, but together with rows of nearly the same joint positions, whose errors are the
        same. At a fixed point rows that were recorded one after the other resemble each
        other, so that a third of its rows is left out together, or the whole placement, for
        errors that depend on the place.
        """
        if self.leaves_placements_out:
            assert self.placements is not None
            return self.placements
        if self.fixed_points is None:
            blocks = self._neighbourhoods
        else:
            blocks = np.zeros_like(self.fixed_points)
            for point in np.unique(self.fixed_points):
                rows = np.flatnonzero(self.fixed_points == point)
                blocks[rows] = rows[len(rows) * np.arange(3) // 3].repeat(
                    np.diff(len(rows) * np.arange(4) // 3)
                )
        numbers, block = np.unique(blocks, return_inverse=True)
        return (np.random.default_rng(0).permutation(len(numbers)) % _FOLDS)[block]

    @property
    def _neighbourhoods(self) -> NDArray[np.int64]:
        """``(n,)`` number of the first row that is near in joint space, each row in one group."""
        tree, numbers = KDTree(self.joint_positions), np.full(len(self), -1)
        for row, joint_positions in enumerate(self.joint_positions):
            if numbers[row] < 0:
                near = np.array(tree.query_ball_point(joint_positions, _SAME_PLACE))
                numbers[near[numbers[near] < 0]] = row
        # Most rows in one place are no repetition: there is no other place to learn from.
        counts = np.bincount(numbers, minlength=len(self))[numbers]
        return np.where(counts > _MOST * len(self), np.arange(len(self)), numbers)

    def elsewhere(
        self, joint_positions: FloatArray, fixed_points: NDArray[np.int64] | None
    ) -> "Observations":
        """Examples ``(n, dof)`` that were not measured: what is measured of them is arbitrary."""
        count = len(joint_positions)
        return replace(
            self,
            joint_positions=joint_positions,
            positions=np.zeros((count, 3)),
            rotations=np.tile(np.eye(3), (count, 1, 1)),
            weights=np.ones(count),
            fixed_points=fixed_points,
        )

    def weighted(self, weights: FloatArray) -> "Observations":
        """The same examples with other weights ``(n,)``."""
        return replace(self, weights=weights)

    def where(self, keep: NDArray[np.bool_]) -> "Observations":
        """The examples where ``keep`` ``(n,)`` is true."""
        return replace(
            self,
            joint_positions=self.joint_positions[keep],
            positions=self.positions[keep],
            rotations=self.rotations[keep],
            weights=self.weights[keep],
            fixed_points=None if self.fixed_points is None else self.fixed_points[keep],
        )

    def residuals(
        self,
        positions: FloatArray,
        rotations: FloatArray,
        noise: Noise,
        unknowns: FloatArray | None = None,
    ) -> FloatArray:
        """Model minus measurement ``(n, rows)``, in standard deviations; instrument's frame."""
        frames = self.frames if unknowns is None else self.frames.moved(unknowns)
        turn, tool = frames.base[:3, :3], frames.tool
        points = positions + rotations @ tool[:3, 3]
        if self.fixed_points is not None:
            return np.asarray((points - frames.points[self.fixed_points]) / noise.position)
        linear = (points @ turn.T + frames.base[:3, 3] - self.positions) / noise.position
        if not self.has_orientation:
            return np.asarray(linear)
        reached = turn @ rotations @ tool[:3, :3]
        turns = Rotation.from_matrix(reached @ np.swapaxes(self.rotations, 1, 2))
        return np.concatenate([linear, turns.as_rotvec() / noise.orientation], axis=1)

    def derivatives(
        self, evaluated: Evaluated, noise: Noise, unknowns: FloatArray | None = None
    ) -> FloatArray:
        """Derivatives ``(n, rows, p + unknowns)`` of the residuals, of a model and of the frames.

        To first order in the angles of the residuals.
        """
        frames = self.frames if unknowns is None else self.frames.moved(unknowns)
        turn, tool = frames.base[:3, :3], frames.tool
        positions, rotations, columns = evaluated
        levers = rotations @ tool[:3, 3]
        # Motions of the end effector to those of the tool, in the frame of the instrument.
        to_tool = np.zeros((len(positions), 6, 6))
        to_tool[:, :3, :3] = to_tool[:, 3:, 3:] = turn
        to_tool[:, :3, 3:] = turn @ np.cross(np.eye(3), levers[:, :, None], axis=1)
        blocks = [to_tool @ columns]
        count, axes = len(positions), turn @ rotations @ tool[:3, :3]
        if frames.base_unknown:
            arms = (positions + levers) @ turn.T + frames.base[:3, 3] - frames.centre
            block = np.zeros((count, 6, 6))
            block[:, range(6), range(6)] = 1.0
            block[:, :3, 3:] = -np.cross(arms[:, None, :], np.eye(3)).swapaxes(1, 2)
            blocks.append(block)
        if frames.tool_unknowns:
            block = np.zeros((count, 6, frames.tool_unknowns))
            block[:, :3, :3] = axes
            block[:, 3:, 3:] = axes[:, :, : frames.tool_unknowns - 3]
            blocks.append(block)
        if self.fixed_points is not None:
            block = np.zeros((count, 6, len(frames.points), 3))
            block[np.arange(count), :3, self.fixed_points] = -np.eye(3)
            blocks.append(block.reshape(count, 6, -1))
        whole = np.concatenate(blocks, axis=2)
        linear = whole[:, :3] / noise.position
        if not self.has_orientation:
            return np.asarray(linear)
        return np.concatenate([linear, whole[:, 3:] / noise.orientation], axis=1)

    def distance_residuals(self, unknowns: FloatArray) -> FloatArray:
        """Known distances between fixed points: model minus known, in their tolerance."""
        points = self.frames.moved(unknowns).points
        return np.array(
            [
                (float(np.linalg.norm(points[first] - points[second])) - metres) / DISTANCE_SIGMA
                for first, second, metres in self.distances
            ]
        )

    def distance_derivatives(self, unknowns: FloatArray) -> FloatArray:
        """Their derivatives ``(distances, unknowns)``."""
        frames = self.frames.moved(unknowns)
        derivatives = np.zeros((len(self.distances), frames.size))
        begin = frames.size - frames.points.size
        for row, (first, second, _) in enumerate(self.distances):
            away = frames.points[first] - frames.points[second]
            away = away / max(float(np.linalg.norm(away)), 1e-9) / DISTANCE_SIGMA
            derivatives[row, begin + 3 * first : begin + 3 * first + 3] = away
            derivatives[row, begin + 3 * second : begin + 3 * second + 3] = -away
        return derivatives
