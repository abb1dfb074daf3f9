"""A UR5e that is not as described: its Denavit-Hartenberg parameters have errors.

Written without annik's kinematics, so that what is learned is judged by something else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: The maker's parameters of the UR5e: d [m], a [m], alpha [rad].
_D = np.array([0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996])
_A = np.array([0.0, -0.425, -0.3922, 0.0, 0.0, 0.0])
_ALPHA = np.pi * np.array([0.5, 0.0, 0.0, 0.5, -0.5, 0.0])
#: From the base of these parameters to the URDF's base_link: half a turn about z.
_BASE = np.diag([-1.0, -1.0, 1.0])

POSITION_NOISE = 20e-6
ORIENTATION_NOISE = float(np.radians(0.002))


class PerturbedUr5e:
    """One robot of the kind: errors uniform, as docs/learn_your_robot.md lists them."""

    def __init__(self, seed: int) -> None:
        """Draw its errors."""
        rng = np.random.default_rng(seed)

        def errors(most: float) -> FloatArray:
            return rng.uniform(-most, most, 6)

        self._zeros = errors(np.radians(0.5))
        self._offsets, self._lengths = errors(1e-3), errors(1e-3)
        self._twists = errors(np.radians(0.3))
        self._amplitudes = errors(np.radians(0.2))
        self._phases = rng.uniform(0.0, 2.0 * np.pi, 6)

    def pose(self, joint_positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions ``(n, 3)`` [m] and rotations ``(n, 3, 3)`` at commanded ``(n, 6)`` [rad]."""
        turned = joint_positions + self._zeros
        turned = turned + self._amplitudes * np.sin(joint_positions + self._phases)
        rotation = np.tile(_BASE, (len(turned), 1, 1))
        position = np.zeros((len(turned), 3))
        for joint in range(6):
            rotation = rotation @ _about(2, turned[:, joint])
            along = np.array([self._lengths[joint] + _A[joint], 0.0, 0.0])
            along[2] = self._offsets[joint] + _D[joint]
            position = position + rotation @ along
            twist = np.full(len(turned), _ALPHA[joint] + self._twists[joint])
            rotation = rotation @ _about(0, twist)
        return position, rotation


def measured(
    robot: PerturbedUr5e, joint_positions: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """The same with noise."""
    position, rotation = robot.pose(joint_positions)
    position = position + rng.normal(0.0, POSITION_NOISE, position.shape)
    for axis in range(3):
        rotation = rotation @ _about(axis, rng.normal(0.0, ORIENTATION_NOISE, len(rotation)))
    return position, rotation


def _about(axis: int, angles: FloatArray) -> FloatArray:
    """``(n, 3, 3)`` turns about a coordinate axis."""
    matrices = np.zeros((len(angles), 3, 3))
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrices[:, axis, axis] = 1.0
    matrices[:, first, first] = matrices[:, second, second] = np.cos(angles)
    matrices[:, second, first] = np.sin(angles)
    matrices[:, first, second] = -np.sin(angles)
    return matrices
