"""Rotations as matrices and as the angles of a URDF."""

from __future__ import annotations

import math

import numpy as np

from annik_core.pose import FloatArray


def pose_matrix(pose: FloatArray) -> FloatArray:
    """Homogeneous matrix ``(4, 4)`` of a pose ``(7,)``: x, y, z [m], unit qx, qy, qz, qw.

    By hand, because it is timed with each solve and scipy's Rotation costs several times as much.
    """
    x, y, z, i, j, k, w = pose.tolist()
    return np.array(
        [
            [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w), x],
            [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w), y],
            [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j), z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def roll_pitch_yaw(rotation: FloatArray) -> tuple[float, float, float]:
    """Rotations [rad] about the fixed x, y and z axes, in this order, that make up a rotation.

    Exact to rounding also where roll and yaw turn about the same axis: roll is found with yaw
    taken away, so that it makes up for what is arbitrary in yaw.

    Args:
        rotation: ``(3, 3)``.
    """
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    sine, cosine = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(
        sine * rotation[0, 2] - cosine * rotation[1, 2],
        cosine * rotation[1, 1] - sine * rotation[0, 1],
    )
    return roll, pitch, yaw
