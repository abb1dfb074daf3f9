"""Poses as arrays, their checks, and the difference between two of them.

A pose is an array ``(7,)`` of float64, ``x, y, z`` [m] and the unit quaternion ``qx, qy, qz, qw``,
of the end effector in the base frame; many poses are ``(n, 7)``. Roll, pitch and yaw are rotations
about the fixed x, y and z axes, in this order (REP-103), the paper's psi, theta and phi.

Rotations of many poses are computed by :class:`scipy.spatial.transform.Rotation`, which is loaded
on first use; functions of one pose use plain floats, because they are on the hot path.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from annik_core.errors import NonFiniteValue, NotUnitQuaternion, WrongShape

FloatArray = NDArray[np.float64]
#: A few numbers, as an array or, where that is quicker, as a tuple.
Numbers = FloatArray | tuple[float, ...]

POSE_FIELDS = (
    "position.x",
    "position.y",
    "position.z",
    "orientation.x",
    "orientation.y",
    "orientation.z",
    "orientation.w",
)

#: How far a quaternion's norm may be from one and still be normalised rather than refused.
QUATERNION_NORM_TOLERANCE = 1e-3
#: Within this part of it, however the norm is rounded.
CERTAIN_NORM = (1.0 - 1e-9) * QUATERNION_NORM_TOLERANCE
#: Nearer to 90 degrees, roll and yaw lose digits: the encoding in a model's graph has more [rad].
ACCURATE_PITCH = 0.5 * math.pi - 1e-3
#: A norm this close to one is one, to rounding.
_ROUNDING = 4 * float(np.finfo(np.float64).eps)


def checked_pose(pose: ArrayLike) -> FloatArray:
    """A pose ``(7,)`` as a new array, its quaternion normalised.

    A quaternion whose norm is 1 to rounding is kept bit for bit.

    Raises:
        WrongShape: if it is not seven numbers.
        NonFiniteValue: if a number is NaN or infinite; names the field.
        NotUnitQuaternion: if the norm is not 1 within :data:`QUATERNION_NORM_TOLERANCE`.
    """
    checked = np.array(pose, dtype=np.float64)
    if checked.shape != (7,):
        raise WrongShape("pose", checked.shape, "(7,): x, y, z, qx, qy, qz, qw")
    # Plain floats: for seven numbers NumPy's functions take several times as long.
    numbers = checked.tolist()
    if not all(map(math.isfinite, numbers)):
        index = [math.isfinite(number) for number in numbers].index(False)
        raise NonFiniteValue(POSE_FIELDS[index], numbers[index])
    norm = math.hypot(*numbers[3:])
    deviation = abs(norm - 1.0)
    if not deviation <= QUATERNION_NORM_TOLERANCE:
        raise NotUnitQuaternion(norm, QUATERNION_NORM_TOLERANCE)
    if deviation > _ROUNDING:
        checked[3:] /= norm
    return checked


def normalise_rows(poses: FloatArray) -> NDArray[np.bool_]:
    """Which rows ``(n, 7)`` :func:`checked_pose` certainly accepts; these are normalised in place.

    A row that is not among them may be good too, and is as it was.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.linalg.norm(poses[:, 3:], axis=1)
        deviations = np.abs(norms - 1.0)
    good: NDArray[np.bool_] = np.isfinite(poses).all(axis=1) & (deviations < CERTAIN_NORM)
    uneven = good & (deviations > _ROUNDING)
    poses[uneven, 3:] /= norms[uneven, np.newaxis]
    return good


def pose_from_roll_pitch_yaw(position: ArrayLike, roll_pitch_yaw: ArrayLike) -> FloatArray:
    """Poses ``(n, 7)`` or ``(7,)`` from positions [m] and roll, pitch, yaw [rad]; w >= 0."""
    from scipy.spatial.transform import Rotation

    angles = np.asarray(roll_pitch_yaw, dtype=np.float64)
    quaternion = Rotation.from_euler("xyz", angles).as_quat(canonical=True)
    return np.concatenate([np.asarray(position, dtype=np.float64), quaternion], axis=-1)


def pose_difference(target: FloatArray, achieved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Difference from the achieved poses to the targets, checked poses ``(7,)`` or ``(n, 7)``.

    Its rotation is that of ``R_target R_achieved^T``, the shorter way round. A quaternion and its
    negative are the same orientation.

    Returns:
        Position difference [m] and rotation vector [rad, norm in [0, pi]] in the base frame, each
        ``(3,)`` or ``(n, 3)``.
    """
    from scipy.spatial.transform import Rotation

    position = target[..., :3] - achieved[..., :3]
    rotation = Rotation.from_quat(target[..., 3:]) * Rotation.from_quat(achieved[..., 3:]).inv()
    return position, rotation.as_rotvec()


def single_pose_difference(
    target: FloatArray, achieved: FloatArray
) -> tuple[list[float], list[float]]:
    """:func:`pose_difference` of one pose ``(7,)`` each, as lists of three numbers [m], [rad].

    In plain floats, because it is on the hot path.
    """
    return difference_of_numbers(target.tolist(), achieved.tolist())


def difference_of_numbers(
    target: list[float], achieved: list[float]
) -> tuple[list[float], list[float]]:
    """:func:`single_pose_difference` of lists of seven numbers."""
    x, y, z, a, b, c, d = target
    from_x, from_y, from_z, e, f, g, h = achieved
    # The vector and the scalar part of the quaternion product q_target conjugate(q_achieved).
    i = a * h - d * e - b * g + c * f
    j = b * h - d * f - c * e + a * g
    k = c * h - d * g - a * f + b * e
    scalar = a * e + b * f + c * g + d * h
    sine = math.hypot(i, j, k)
    # The shorter way round; for small angles 2 atan2(sine, cosine) / sine is 2.
    half_angle = math.atan2(sine, abs(scalar))
    factor = math.copysign(2.0 * half_angle / sine if sine > 0.0 else 2.0, scalar)
    return [x - from_x, y - from_y, z - from_z], [factor * i, factor * j, factor * k]


def roll_pitch_yaw(quaternion: FloatArray | list[float]) -> tuple[float, float, float]:
    """Roll, pitch and yaw [rad] of a unit quaternion ``(4,)`` x, y, z, w; quicker for a list.

    Roll and yaw are in [-pi, pi]. At a pitch of 90 degrees only their difference is unique, at -90
    degrees their sum. Accurate up to there [Bernardes2022]_.

    References:
        [Bernardes2022] E. Bernardes, S. Viollet: Quaternion to Euler angles conversion: a direct,
        general and computationally efficient method. PLoS ONE 17(11), 2022.
    """
    x, y, z, w = quaternion
    half_sum = math.atan2(x + z, w - y)
    half_difference = math.atan2(z - x, w + y)
    pitch = 2.0 * math.atan2(math.hypot(w + y, z - x), math.hypot(w - y, x + z)) - 0.5 * math.pi
    return (
        math.remainder(half_sum - half_difference, math.tau),
        pitch,
        math.remainder(half_sum + half_difference, math.tau),
    )


def quaternion_from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> list[float]:
    """Unit quaternion x, y, z, w of roll, pitch, yaw [rad]; w is not negative."""
    sine_roll, cosine_roll = math.sin(0.5 * roll), math.cos(0.5 * roll)
    sine_pitch, cosine_pitch = math.sin(0.5 * pitch), math.cos(0.5 * pitch)
    sine_yaw, cosine_yaw = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    quaternion = [
        sine_roll * cosine_pitch * cosine_yaw - cosine_roll * sine_pitch * sine_yaw,
        cosine_roll * sine_pitch * cosine_yaw + sine_roll * cosine_pitch * sine_yaw,
        cosine_roll * cosine_pitch * sine_yaw - sine_roll * sine_pitch * cosine_yaw,
        cosine_roll * cosine_pitch * cosine_yaw + sine_roll * sine_pitch * sine_yaw,
    ]
    return quaternion if quaternion[3] >= 0.0 else [-part for part in quaternion]


def rotation_matrix(quaternion: FloatArray) -> FloatArray:
    """``(3, 3)`` of a unit quaternion ``(4,)`` x, y, z, w; its columns are the rotated axes."""
    x, y, z, w = quaternion.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def transformed(transform: FloatArray, poses: FloatArray) -> FloatArray:
    """Poses ``(n, 7)``, unchecked, in the frame in which their own frame has the pose ``(7,)``."""
    x, y, z, w = transform[3:].tolist()
    product = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    # What is not finite in a pose stays so, and is refused later.
    with np.errstate(all="ignore"):
        positions = poses[:, :3] @ rotation_matrix(transform[3:]).T + transform[:3]
        return np.hstack([positions, poses[:, 3:] @ product.T])


def pose_distance(target: FloatArray, achieved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Norms of :func:`pose_difference`: distances [m], angles [rad], each ``()`` or ``(n,)``."""
    position, rotation = pose_difference(target, achieved)
    return np.linalg.norm(position, axis=-1), np.linalg.norm(rotation, axis=-1)


@dataclass(frozen=True, eq=False)
class TrackingError:
    """Target minus achieved, ``(3,)`` each in the base frame: [m], and a rotation vector [rad]."""

    position: FloatArray
    orientation: FloatArray


def tracking_error(target: FloatArray, achieved: FloatArray) -> TrackingError:
    """Error of an achieved pose ``(7,)`` against its target ``(7,)``, both checked poses."""
    position, orientation = single_pose_difference(target, achieved)
    return TrackingError(np.array(position), np.array(orientation))
