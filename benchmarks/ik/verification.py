"""Verification of solutions by a forward kinematics that no solver under test uses.

:class:`benchmarks.ik.peers.serial_chain.SerialChain` reads the URDF itself and multiplies
matrices in NumPy, without Pinocchio, which annik refines with, and without the peers' libraries.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
from benchmarks.ik.peers.closed_form import TURN
from benchmarks.ik.peers.problem import IkProblem
from benchmarks.ik.peers.serial_chain import SerialChain

#: Largest position error of a right solution [m].
POSITION_TOLERANCE = 1e-6
#: Largest orientation error of a right solution [rad].
ORIENTATION_TOLERANCE = 1e-6
#: Tolerance of the bounds, for rounding [rad or m].
EDGE = 1e-9

Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Verified:
    """Verified solutions, one entry ``(n,)`` per target.

    Attributes:
        right: within both tolerances of the target.
        in_limits: right, and within the limits of the robot's joints.
        in_box: right, and within the joint box.
    """

    right: Flags
    in_limits: Flags
    in_box: Flags


@dataclass(frozen=True, eq=False)
class Verifier:
    """Checks solutions of one problem.

    Attributes:
        problem: with the URDF, the limits and the box.
    """

    problem: IkProblem

    def verified(self, joint_positions: FloatArray, poses: FloatArray) -> Verified:
        """Check solutions ``(n, dof)``, NaN where there is none, of targets ``(n, 7)``.

        Whole turns are taken off before the bounds are checked, for all solvers, as some know no
        limits.
        """
        position, orientation = self.errors(joint_positions, poses)
        # NaN compares as wrong.
        right = (position <= POSITION_TOLERANCE) & (orientation <= ORIENTATION_TOLERANCE)
        problem = self.problem
        nearest = self.without_turns(joint_positions)
        return Verified(
            right,
            right & _inside(nearest, problem.lower, problem.upper),
            right & _inside(nearest, problem.box_lower, problem.box_upper),
        )

    def errors(
        self, joint_positions: FloatArray, poses: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Distances [m] and angles [rad], each ``(n,)``, of solutions from targets."""
        reached = self._chain.tip_placements(joint_positions)
        wanted = Rotation.from_quat(poses[:, 3:]).as_matrix()
        distance: FloatArray = np.linalg.norm(reached[:, :3, 3] - poses[:, :3], axis=1)
        # The chord between two rotations; unlike the trace, it is exact for small angles.
        chord = np.linalg.norm(reached[:, :3, :3] - wanted, axis=(1, 2)) / np.sqrt(8.0)
        angle: FloatArray = 2.0 * np.arcsin(np.minimum(chord, 1.0))
        return distance, angle

    def without_turns(self, joint_positions: FloatArray) -> FloatArray:
        """The angles of ``(n, dof)`` turned by whole turns to the nearest to the box's centre."""
        turns = np.round((joint_positions - self.problem.start) / TURN) * TURN
        return joint_positions - np.where(self.turning, turns, 0.0)

    def steps(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Largest joint step ``(n,)`` between solutions ``(n, dof)``, without whole turns."""
        differences = after - before
        turns = np.round(differences / TURN) * TURN
        largest: FloatArray = np.abs(differences - np.where(self.turning, turns, 0.0)).max(axis=1)
        return largest

    @cached_property
    def turning(self) -> Flags:
        """Which joints turn ``(dof,)``; the others slide."""
        return np.array([not joint.prismatic for joint in self._chain.joints])

    @cached_property
    def _chain(self) -> SerialChain:
        problem = self.problem
        return SerialChain.from_urdf(problem.urdf, problem.base_frame, problem.end_effector_frame)


def _inside(joint_positions: FloatArray, lower: FloatArray, upper: FloatArray) -> Flags:
    inside = (joint_positions >= lower - EDGE) & (joint_positions <= upper + EDGE)
    return np.asarray(inside.all(axis=1))
