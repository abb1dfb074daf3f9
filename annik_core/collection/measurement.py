"""Measurement of one pose: settling, averaging and outliers.

Whether a robot stands still where it was told to be.

One measured pose from several samples of it, and whether to believe it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from annik_core.collection.settings import CollectionSettings
from annik_core.pose import FloatArray, pose_distance


class Settling:
    """Watches joint positions, until they have been at a target and still for a while."""

    def __init__(
        self, target: FloatArray, tolerance: float, stillness: float, time: float
    ) -> None:
        """Begin to watch.

        Args:
            target: ``(dof,)`` [rad or m].
            tolerance: how far from the target each joint may be [rad or m].
            stillness: how far it may move while it is said to stand still [rad or m].
            time: how long it has to [s].
        """
        self._target = target
        self._tolerance = tolerance
        self._stillness = stillness
        self._time = time
        self._since: float | None = None
        self._reference = target
        self.is_settled = False

    def update(self, time: float, joint_positions: FloatArray) -> bool:
        """Take joint positions ``(dof,)`` measured at ``time`` [s]; whether it has settled."""
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
        """Which joint is furthest from the target, for a robot that does not settle."""
        joint = int(np.abs(joint_positions - self._target).argmax())
        distance = abs(float(joint_positions[joint] - self._target[joint]))
        what = "is" if distance > self._tolerance else "moves still; it is"
        return (
            f"{joint_names[joint]} {what} {distance:.4g} from its command; the settle_tolerance "
            f"is {self._tolerance:.4g}"
        )


def _distance(one: FloatArray, other: FloatArray) -> float:
    return float(np.abs(one - other).max(initial=0.0))


#: A sample this many times further from the middle of the samples than the median one is wild.
#: Of ten samples with Gaussian noise, one in some thousand measurements is.
_WILD = 6.0
#: With fewer samples nobody can tell which of them is the wild one.
_LEAST_FOR_WILD = 4
#: No sample nearer than this to the middle is wild [m and rad]: the last digit of a tracker that
#: rounds what it says.
_RESOLUTION = 2e-5


@dataclass(frozen=True, eq=False)
class PoseAverage:
    """The mean of samples of one pose.

    Attributes:
        pose: ``(7,)`` mean position [m] and mean orientation, a unit quaternion x, y, z, w.
        samples: how many.
        square_sums: of the samples' distances from it [m^2] and of their angles [rad^2].
        spread: largest distance [m] and angle [rad] of a sample from it.
        wild_sample: which sample is far from the others, as they lie among themselves; or None.
    """

    pose: FloatArray
    samples: int
    square_sums: tuple[float, float]
    spread: tuple[float, float]
    wild_sample: int | None


def average_poses(samples: Sequence[FloatArray] | FloatArray) -> PoseAverage:
    """The average of samples ``(k, 7)``, at least one.

    The mean orientation is the one from which the squared chordal distances are least; of a
    quaternion and its negative it takes either for the same [Markley2007]_.

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
        wild_sample=_wild_sample(poses[:, :3], rotation_vectors),
    )


def _wild_sample(*coordinates: FloatArray) -> int | None:
    """The first sample that is far out by its position or its orientation, each ``(k, 3)``."""
    for values in coordinates:
        if len(values) < _LEAST_FOR_WILD:
            return None
        # Medians, which one wild sample does not move.
        distances = np.linalg.norm(values - np.median(values, axis=0), axis=1)
        far = np.flatnonzero(distances > max(_WILD * float(np.median(distances)), _RESOLUTION))
        if len(far):
            return int(far[0])
    return None


def measurement_fault(
    average: PoseAverage, nominal: FloatArray, settings: CollectionSettings
) -> str | None:
    """Why to measure again, or None.

    Args:
        average: what was measured.
        nominal: ``(7,)`` where the forward kinematics of the robot's model leads.
        settings: has the limits.
    """
    if average.wild_sample is not None:
        return (
            f"sample {average.wild_sample + 1} of {average.samples} is far from the others: the "
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
            "the mean is off the forward kinematics by",
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
    """How uncertain averaged poses are by their samples: standard deviations of one of them.

    Pooled over all averages, so that a few samples of each are enough.

    Args:
        averages: number of samples and ``square_sums`` of each; all with the same number.

    Returns:
        Of each coordinate of the position [m], and of each of the orientation as a rotation
        vector [rad]; None if the samples don't say, since there is one of each pose.
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
