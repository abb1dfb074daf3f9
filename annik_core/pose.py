"""Poses as arrays, their checks, and the difference between two of them.

A pose is an array ``(7,)`` of float64, ``x, y, z`` [m] and the unit quaternion ``qx, qy, qz, qw``,
of the end effector in the base frame; many poses are ``(n, 7)``. Rotations are computed by
:class:`scipy.spatial.transform.Rotation`. Roll, pitch and yaw are rotations about the fixed x, y
and z axes, in this order (REP-103), the paper's psi, theta and phi.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from annik_core.errors import NonFiniteValue, NotUnitQuaternion, WrongShape

FloatArray = NDArray[np.float64]

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
#: A norm this close to one is one, to rounding.
_ROUNDING = 4 * float(np.finfo(np.float64).eps)


def checked_pose(pose: ArrayLike) -> FloatArray:
    """A pose that is finite and whose quaternion has unit norm.

    Args:
        pose: ``(7,)``; position [m], quaternion x, y, z, w with a norm of 1 within
            :data:`QUATERNION_NORM_TOLERANCE`.

    Returns:
        A new array ``(7,)`` with the quaternion normalised. One that is already a unit quaternion
        to rounding is returned bit for bit, so that a pose survives a round trip unchanged.

    Raises:
        WrongShape: if it is not seven numbers.
        NonFiniteValue: if a number is NaN or infinite; names the field.
        NotUnitQuaternion: if the norm is too far from one; this includes the zero quaternion.
    """
    checked = np.array(pose, dtype=np.float64)
    if checked.shape != (7,):
        raise WrongShape("pose", checked.shape, "(7,): x, y, z, qx, qy, qz, qw")
    # Python's own numbers: for seven of them NumPy's functions take several times as long.
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


def pose_from_roll_pitch_yaw(position: ArrayLike, roll_pitch_yaw: ArrayLike) -> FloatArray:
    """Poses from positions and roll, pitch, yaw angles.

    Args:
        position: ``(n, 3)`` or ``(3,)`` [m].
        roll_pitch_yaw: same shape [rad]; rotations about the fixed x, y, z axes, in this order.

    Returns:
        ``(n, 7)`` or ``(7,)``; the quaternion's w is not negative.
    """
    angles = np.asarray(roll_pitch_yaw, dtype=np.float64)
    quaternion = Rotation.from_euler("xyz", angles).as_quat(canonical=True)
    return np.concatenate([np.asarray(position, dtype=np.float64), quaternion], axis=-1)


def pose_difference(target: FloatArray, achieved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What is missing from the achieved poses to reach the targets, in the base frame.

    The rotation part is the rotation vector of ``R_target R_achieved^T``: its norm is the angle
    between the two orientations. A quaternion and its negative are the same orientation.

    Args:
        target: ``(7,)`` or ``(n, 7)``, checked poses.
        achieved: same shape.

    Returns:
        Position difference [m] and rotation vector [rad, norm in [0, pi]], each ``(3,)`` or
        ``(n, 3)``.
    """
    position = target[..., :3] - achieved[..., :3]
    rotation = Rotation.from_quat(target[..., 3:]) * Rotation.from_quat(achieved[..., 3:]).inv()
    return position, rotation.as_rotvec()


def pose_distance(target: FloatArray, achieved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How far the achieved poses are from the targets: the norms of :func:`pose_difference`.

    Args:
        target: ``(7,)`` or ``(n, 7)``, checked poses.
        achieved: same shape.

    Returns:
        Distances [m] and angles [rad, in [0, pi]], each ``()`` or ``(n,)``.
    """
    position, rotation = pose_difference(target, achieved)
    return np.linalg.norm(position, axis=-1), np.linalg.norm(rotation, axis=-1)
