"""Forward kinematics of an arm whose joints and end effector are not where they are told to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.corrections import JointCorrection, PoseNetwork
from annik_core.robots.robot import ForwardKinematics, Linearisation


@dataclass(frozen=True, eq=False)
class JointCorrectedKinematics(ForwardKinematics):
    """Forward kinematics as a function of the commanded joint positions.

    Attributes:
        kinematics: of the actual joint positions.
        correction: from the commanded to the actual ones.
    """

    kinematics: ForwardKinematics
    correction: JointCorrection

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return self.kinematics.poses(self.correction.actual(joint_positions))

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        jacobians = self.kinematics.jacobians(self.correction.actual(joint_positions))
        return jacobians * self.correction.slopes(joint_positions)[:, np.newaxis, :]

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        correction = self.correction
        twist, jacobian, displacement = self.kinematics.linearise(
            correction.actual(joint_positions), target
        )
        return Linearisation(twist, jacobian * correction.slopes(joint_positions), displacement)


@dataclass(frozen=True, eq=False)
class PoseCorrectedKinematics(ForwardKinematics):
    """Forward kinematics with a motion of the end effector in its own frame after it.

    The Jacobians are those without that motion, which changes with the joint positions a thousand
    times less than the pose does: a search by them needs no step more.

    Attributes:
        kinematics: without the motion.
        network: the motion, as a function of the joint positions.
    """

    kinematics: ForwardKinematics
    network: PoseNetwork

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return _moved(
            self.kinematics.poses(joint_positions), self.network.motions(joint_positions)
        )

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return self.kinematics.jacobians(joint_positions)

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        # To reach the target with the motion is to reach its reverse without.
        motion = self.network.motions(joint_positions[np.newaxis])
        moved = _moved(target[np.newaxis], motion, reverse=True)[0]
        return self.kinematics.linearise(joint_positions, moved)


def _moved(poses: FloatArray, motions: FloatArray, *, reverse: bool = False) -> FloatArray:
    """Poses ``(n, 7)`` after motions ``(n, 6)`` in their own frames, or before them.

    The motions are so small that the exponential's coupling of rotation and translation is one
    half of their cross product, to 1e-9 of a metre.
    """
    from scipy.spatial.transform import Rotation

    linear, angular = motions[:, :3], motions[:, 3:]
    linear = linear + 0.5 * np.cross(angular, linear)
    turn = Rotation.from_rotvec(angular)
    if reverse:
        turn = turn.inv()
        linear = -turn.apply(linear)
    before = Rotation.from_quat(poses[:, 3:])
    return np.concatenate(
        [poses[:, :3] + before.apply(linear), (before * turn).as_quat(canonical=True)], axis=1
    )
