"""Measurement of one pose: settling, averaging and outliers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from annik_core.collection.settings import CollectionSettings
from annik_core.pose import FloatArray, pose_distance


class Settling:
    """Detects when joint positions have been at a target, and still, for some time."""

    def __init__(
        self, target: FloatArray, tolerance: float, stillness: float, time: float
    ) -> None:
        """Start; in [rad or m], and the time that the robot must stand still in [s]."""
        self._target = target
        self._tolerance = tolerance
        self._stillness = stillness
        self._time = time
        self._since: float | None = None
        self._reference = target
        self.is_settled = False

    def update(self, time: float, joint_positions: FloatArray) -> bool:
        """Add joint positions ``(dof,)`` measured at ``time`` [s]; whether it has settled."""
        if not self.is_near_target(joint_positions):
            self._since = None
        elif self._since is None or _distance(joint_positions, self._reference) > self._stillness:
            self._since, self._reference = time, joint_positions
        self.is_settled = self._since is not None and time - self._since >= self._time
        return self.is_settled

    def is_near_target(self, joint_positions: FloatArray) -> bool:
        """Whether every joint is within the tolerance of the target."""
        return _distance(joint_positions, self._target) <= self._tolerance

    def describe(self, joint_names: tuple[str, ...], joint_positions: FloatArray) -> str:
        """The joint that is furthest from the target, in words."""
        joint = int(np.abs(joint_positions - self._target).argmax())
        distance = abs(float(joint_positions[joint] - self._target[joint]))
        what = "is" if distance > self._tolerance else "still moves; it is"
        return (
            f"{joint_names[joint]} {what} {distance:.4g} from its command; the settle_tolerance "
            f"is {self._tolerance:.4g}"
        )


def _distance(one: FloatArray, other: FloatArray) -> float:
    return float(np.abs(one - other).max(initial=0.0))


#: A sample is an outlier beyond this many median distances from the median of the samples: with
#: Gaussian noise and ten samples, about once in a thousand measurements.
_OUTLIER = 6.0
#: With fewer samples an outlier can't be told from the others.
_LEAST_FOR_OUTLIER = 4
#: A sample nearer than this to the median is no outlier [m and rad]: trackers round.
_RESOLUTION = 2e-5


@dataclass(frozen=True, eq=False)
class PoseAverage:
    """The mean of samples of one pose.

    Attributes:
        pose: ``(7,)`` mean position [m] and mean orientation, a unit quaternion x, y, z, w.
        square_sums: sums of squares of the samples' distances [m^2] and angles [rad^2] from it.
        spread: largest distance [m] and angle [rad] of a sample from it.
        outlier: index of a sample that is far from the others, or None.
    """

    pose: FloatArray
    samples: int
    square_sums: tuple[float, float]
    spread: tuple[float, float]
    outlier: int | None


def average_poses(samples: Sequence[FloatArray] | FloatArray) -> PoseAverage:
    """The average of samples ``(k, 7)``, at least one.

    The mean orientation minimises the sum of squared chordal distances; a quaternion and its
    negative count as the same [Markley2007]_.

    References:
        [Markley2007] F. L. Markley et al.: Averaging quaternions. Journal of Guidance, Control,
        and Dynamics 30(4), 2007.
    """
    from scipy.spatial.transform import Rotation

    poses = np.asarray(samples, dtype=np.float64)
    rotations = Rotation.from_quat(poses[:, 3:])
    mean = np.concatenate([poses[:, :3].mean(axis=0), rotations.mean().as_quat(canonical=True)])
    distances, angles = pose_distance(np.broadcast_to(mean, poses.shape), poses)
    rotation_vectors = (rotations * Rotation.from_quat(mean[3:]).inv()).as_rotvec()
    return PoseAverage(
        pose=mean,
        samples=len(poses),
        square_sums=(float((distances**2).sum()), float((angles**2).sum())),
        spread=(float(distances.max()), float(angles.max())),
        outlier=_outlier(poses[:, :3], rotation_vectors),
    )


def _outlier(*coordinates: FloatArray) -> int | None:
    """The first outlier by position or orientation, each ``(k, 3)``."""
    for values in coordinates:
        if len(values) < _LEAST_FOR_OUTLIER:
            return None
        # Medians, which one outlier does not change.
        distances = np.linalg.norm(values - np.median(values, axis=0), axis=1)
        far = np.flatnonzero(distances > max(_OUTLIER * float(np.median(distances)), _RESOLUTION))
        if len(far):
            return int(far[0])
    return None


def measurement_fault(
    average: PoseAverage, nominal: FloatArray, settings: CollectionSettings
) -> str | None:
    """Why a measurement must be repeated, or None; ``nominal`` is the pose by the kinematics."""
    if average.outlier is not None:
        return (
            f"sample {average.outlier + 1} of {average.samples} is far from the others: the "
            f"samples differ by up to {_in_words(*average.spread)} from their mean"
        )
    distance, angle = (float(value) for value in pose_distance(nominal, average.pose))
    for what, values, limits in (
        (
            "the samples differ from their mean by up to",
            average.spread,
            (settings.max_position_spread, settings.max_orientation_spread),
        ),
        (
            "the mean differs from the nominal forward kinematics by",
            (distance, angle),
            (settings.max_position_deviation, settings.max_orientation_deviation),
        ),
    ):
        if not all(value <= limit for value, limit in zip(values, limits, strict=True)):
            return f"{what} {_in_words(*values)}; allowed are {_in_words(*limits)}"
    return None


def _in_words(distance: float, angle: float) -> str:
    return f"{1e3 * distance:.4g} mm and {angle:.4g} rad"


def noise_of_averages(
    averages: Sequence[tuple[int, tuple[float, float]]],
) -> tuple[float, float] | None:
    """Standard deviations of averaged poses, pooled over ``square_sums`` of all averages.

    Of each coordinate of the position [m], and of the orientation as a rotation vector [rad]; None
    if unknown, with one sample of each pose.
    """
    freedom = sum(samples - 1 for samples, _ in averages)
    if freedom <= 0:
        return None
    samples = averages[0][0]
    position, orientation = (
        math.sqrt(math.fsum(sums[kind] for _, sums in averages) / (3 * freedom * samples))
        for kind in (0, 1)
    )
    return position, orientation
