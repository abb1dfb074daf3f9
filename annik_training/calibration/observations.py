"""Measured poses, their noise, and the residuals of a model."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.dataset import Dataset
from annik_core.errors import NonFiniteValue, RobotMismatch
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot


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

    @classmethod
    def of(cls, dataset: Dataset, *, position_only: bool = False) -> "Observations":
        """All examples of a dataset, with full weight.

        Raises:
            NonFiniteValue: naming the first row with a number that is not finite.
        """
        measured = 3 if position_only else 7
        for name, array in (
            ("joint positions", dataset.joint_positions),
            ("poses", dataset.poses[:, :measured]),
        ):
            for row, column in np.argwhere(~np.isfinite(array))[:1]:
                raise NonFiniteValue(f"row {row} of the {name}", float(array[row, column]))
        rotations = np.tile(np.eye(3), (len(dataset), 1, 1))
        if not position_only:
            rotations = Rotation.from_quat(dataset.poses[:, 3:]).as_matrix()
        return cls(
            dataset.robot.in_box(dataset.joint_positions),
            dataset.poses[:, :3],
            rotations,
            not position_only,
            np.ones(len(dataset)),
        )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def rows(self) -> int:
        """Measured numbers per example."""
        return 6 if self.has_orientation else 3

    def weighted(self, weights: FloatArray) -> "Observations":
        """The same examples with other weights ``(n,)``."""
        return replace(self, weights=weights)

    def where(self, keep: NDArray[np.bool_]) -> "Observations":
        """The examples where ``keep`` ``(n,)`` is true."""
        return Observations(
            self.joint_positions[keep],
            self.positions[keep],
            self.rotations[keep],
            self.has_orientation,
            self.weights[keep],
        )

    def residuals(self, positions: FloatArray, rotations: FloatArray, noise: Noise) -> FloatArray:
        """Model minus measurement ``(n, rows)``, in standard deviations; base frame."""
        linear = (positions - self.positions) / noise.position
        if not self.has_orientation:
            return linear
        turns = Rotation.from_matrix(rotations @ np.swapaxes(self.rotations, 1, 2))
        return np.concatenate([linear, turns.as_rotvec() / noise.orientation], axis=1)

    def derivatives(self, columns: FloatArray, noise: Noise) -> FloatArray:
        """Derivatives ``(n, rows, p)`` of the residuals, from those of the pose ``(n, 6, p)``.

        To first order in the angles of the residuals.
        """
        linear = columns[:, :3] / noise.position
        if not self.has_orientation:
            return linear
        return np.concatenate([linear, columns[:, 3:] / noise.orientation], axis=1)
