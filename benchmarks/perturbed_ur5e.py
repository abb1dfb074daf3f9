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
#: The maker's masses of the links [kg] and their centres, each in its link's frame [m].
_MASSES = np.array([3.761, 8.058, 2.846, 1.37, 1.3, 0.365])
_CENTRES = np.array(
    [
        [0.0, -0.02561, 0.00193],
        [0.2125, 0.0, 0.11336],
        [0.15, 0.0, 0.0265],
        [0.0, -0.0018, 0.01634],
        [0.0, 0.0018, 0.01634],
        [0.0, 0.0, -0.001159],
    ]
)
_GRAVITY = np.array([0.0, 0.0, -9.81])
#: Largest turn of a joint that yields to gravity, as one with a harmonic drive does [rad/(N m)].
COMPLIANCE = 5e-5
#: From the base of these parameters to the URDF's base_link: half a turn about z.
_BASE = np.diag([-1.0, -1.0, 1.0])

POSITION_NOISE = 20e-6
ORIENTATION_NOISE = float(np.radians(0.002))


class PerturbedUr5e:
    """One robot of the kind: errors uniform, as docs/learn_your_robot.md lists them."""

    def __init__(self, seed: int, *, yields: bool = False) -> None:
        """Draw its errors; with ``yields`` also joints that turn under the weight of the links."""
        rng = np.random.default_rng(seed)

        def errors(most: float) -> FloatArray:
            return rng.uniform(-most, most, 6)

        self._zeros = errors(np.radians(0.5))
        self._offsets, self._lengths = errors(1e-3), errors(1e-3)
        self._twists = errors(np.radians(0.3))
        self._amplitudes = errors(np.radians(0.2))
        self._phases = rng.uniform(0.0, 2.0 * np.pi, 6)
        self._compliances = rng.uniform(0.0, COMPLIANCE, 6) if yields else np.zeros(6)

    def pose(self, joint_positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions ``(n, 3)`` [m] and rotations ``(n, 3, 3)`` at commanded ``(n, 6)`` [rad]."""
        turned = joint_positions + self._zeros
        turned = turned + self._amplitudes * np.sin(joint_positions + self._phases)
        turned = turned + self._compliances * _moments(*self._frames(turned))
        rotations, positions = self._frames(turned)
        return positions[-1], rotations[-1]

    def _frames(self, turned: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rotations ``(7, n, 3, 3)`` and positions ``(7, n, 3)`` of the base and of each link."""
        rotations = [np.tile(_BASE, (len(turned), 1, 1))]
        positions = [np.zeros((len(turned), 3))]
        for joint in range(6):
            rotation = rotations[-1] @ _about(2, turned[:, joint])
            along = np.array([self._lengths[joint] + _A[joint], 0.0, 0.0])
            along[2] = self._offsets[joint] + _D[joint]
            positions.append(positions[-1] + rotation @ along)
            twist = np.full(len(turned), _ALPHA[joint] + self._twists[joint])
            rotations.append(rotation @ _about(0, twist))
        return np.array(rotations), np.array(positions)


def _moments(rotations: FloatArray, positions: FloatArray) -> FloatArray:
    """Moments ``(n, 6)`` of the links' weights about the joints' axes [N m]."""
    centres = positions[1:] + np.einsum("lnij,lj->lni", rotations[1:], _CENTRES)
    moments = np.zeros((positions.shape[1], 6))
    for joint in range(6):
        for link in range(joint, 6):
            turning = np.cross(centres[link] - positions[joint], _MASSES[link] * _GRAVITY)
            moments[:, joint] += (turning * rotations[joint, :, :, 2]).sum(axis=1)
    return moments


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
