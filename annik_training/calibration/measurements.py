"""What was measured on an arm: poses, positions, or joint positions at fixed points."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.dataset import Dataset
from annik_core.errors import NonFiniteValue
from annik_core.pose import FloatArray
from annik_training.calibration.errors import InvalidMeasurements

#: Largest deviation of a rotation matrix from an orthogonal one.
_ROTATION_TOLERANCE = 1e-6


class KnownDistance(NamedTuple):
    """The distance between two fixed points, by their numbers."""

    first: int
    second: int
    metres: float


@dataclass(frozen=True, eq=False)
class Measurements:
    """Joint positions of an arm, and what was measured at each of them.

    Either ``positions``, with or without ``rotations``, in the frame of the instrument; or
    ``fixed_points``, where the tool point touches points at unknown places, such as a ball in
    sockets.

    Attributes:
        joint_positions: ``(n, dof)`` as commanded, in the robot's order of joints [rad or m].
        positions: ``(n, 3)`` of the tool point [m].
        rotations: ``(n, 3, 3)`` of the tool.
        fixed_points: ``(n,)`` number of the point that is touched, the same number only for the
            same hole at the same placement.
        distances: known distances between fixed points.
        frame_known: whether the instrument's frame is the robot's base frame.
        tool_known: whether the tool is the robot's end effector frame.
        sigma: standard deviations of a measured position along each axis [m] and of an
            orientation about each axis [rad]; None if unknown.

    Raises:
        InvalidMeasurements: naming the array and what is wrong.
        NonFiniteValue: naming the first row with a number that is not finite.
    """

    joint_positions: FloatArray
    positions: FloatArray | None = None
    rotations: FloatArray | None = None
    fixed_points: NDArray[np.int64] | None = None
    distances: Sequence[KnownDistance] = field(default=())
    frame_known: bool = False
    tool_known: bool = False
    sigma: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Refuse arrays that don't fit each other."""
        joints = np.asarray(self.joint_positions)
        if joints.ndim != 2 or not joints.size:
            raise InvalidMeasurements("joint_positions", f"shape {joints.shape}, not (n, joints)")
        if (self.positions is None) == (self.fixed_points is None):
            raise InvalidMeasurements("positions", "give either positions or fixed_points")
        if self.rotations is not None and self.positions is None:
            raise InvalidMeasurements("rotations", "given without positions")
        if self.frame_known and self.fixed_points is not None:
            raise InvalidMeasurements("frame_known", "given with fixed_points: they have none")
        count = len(joints)
        for name, shape in (
            ("positions", (count, 3)),
            ("rotations", (count, 3, 3)),
            ("fixed_points", (count,)),
        ):
            array = getattr(self, name)
            if array is not None and np.shape(array) != shape:
                raise InvalidMeasurements(name, f"shape {np.shape(array)}, not {shape}")
        for name in ("joint_positions", "positions", "rotations"):
            array = getattr(self, name)
            if array is not None:
                for index in np.argwhere(~np.isfinite(array))[:1]:
                    what = f"row {index[0]} of the {name.replace('_', ' ')}"
                    raise NonFiniteValue(what, float(array[tuple(index)]))
        self._check_rotations()
        self._check_distances()
        if self.sigma is not None and not (np.isfinite(self.sigma).all() and min(self.sigma) >= 0):
            raise InvalidMeasurements("sigma", f"{self.sigma}, not zero or more")

    @classmethod
    def of(cls, dataset: Dataset, *, position_only: bool = False) -> "Measurements":
        """The poses of a dataset: of the end effector frame in the base frame."""
        used = dataset.poses[:, :3] if position_only else dataset.poses
        for row, column in np.argwhere(~np.isfinite(used))[:1]:
            raise NonFiniteValue(f"row {row} of the poses", float(used[row, column]))
        return cls(
            dataset.joint_positions,
            dataset.poses[:, :3],
            None if position_only else Rotation.from_quat(dataset.poses[:, 3:]).as_matrix(),
            frame_known=True,
            tool_known=True,
            sigma=dataset.measurement_noise,
        )

    def __len__(self) -> int:
        return len(self.joint_positions)

    def where(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> "Measurements":
        """The rows ``keep``, a mask or indices."""
        arrays: dict[str, Any] = {
            name: None if array is None else array[keep]
            for name in ("joint_positions", "positions", "rotations", "fixed_points")
            for array in (getattr(self, name),)
        }
        touched = set() if self.fixed_points is None else set(self.fixed_points[keep].tolist())
        distances = [one for one in self.distances if {one[0], one[1]} <= touched]
        return replace(self, **arrays, distances=distances)

    @property
    def touched(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Numbers ``(m,)`` of the fixed points, ascending, and which of these ``(n,)`` rows touch.

        Raises:
            InvalidMeasurements: if positions were measured.
        """
        if self.fixed_points is None:
            raise InvalidMeasurements("fixed_points", "positions were measured instead")
        numbers, rows = np.unique(self.fixed_points, return_inverse=True)
        return numbers, rows

    @property
    def content_hash(self) -> str:
        """SHA-256 over all arrays."""
        digest = hashlib.sha256()
        for name in ("joint_positions", "positions", "rotations", "fixed_points"):
            array = getattr(self, name)
            digest.update(f"{name} {np.shape(array)}".encode())
            if array is not None:
                digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def _check_rotations(self) -> None:
        if self.rotations is None:
            return
        products = self.rotations @ np.swapaxes(self.rotations, 1, 2)
        away = np.abs(products - np.eye(3)).max(axis=(1, 2))
        wrong = (away > _ROTATION_TOLERANCE) | (np.linalg.det(self.rotations) < 0.0)
        for row in np.flatnonzero(wrong)[:1]:
            raise InvalidMeasurements("rotations", f"row {row} is no rotation")

    def _check_distances(self) -> None:
        if len(self.distances) and self.fixed_points is None:
            raise InvalidMeasurements("distances", "given without fixed_points")
        known = set() if self.fixed_points is None else set(np.asarray(self.fixed_points).tolist())
        for first, second, metres in self.distances:
            if first == second or not {first, second} <= known:
                raise InvalidMeasurements(
                    "distances", f"between {first} and {second}, not two of the fixed points"
                )
            if not 0.0 < metres < float("inf"):
                raise InvalidMeasurements("distances", f"{metres} m, not positive")
