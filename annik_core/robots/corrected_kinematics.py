"""Forward kinematics of an arm with corrections of its joints and its end effector."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.corrections import JointCorrection, PoseNetwork
from annik_core.robots.robot import ForwardKinematics, Linearisation, unwrapped


@dataclass(frozen=True, eq=False)
class JointCorrectedKinematics(ForwardKinematics):
    """Forward kinematics as a function of commanded instead of actual joint positions."""

    kinematics: ForwardKinematics
    correction: JointCorrection

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return self.kinematics.poses(self.correction.actual(joint_positions))

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        jacobians = self.kinematics.jacobians(self.correction.actual(joint_positions))
        return jacobians * self.correction.derivatives(joint_positions)[:, np.newaxis, :]

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        actual = self.correction.actual(joint_positions)
        found = self.kinematics.linearise(actual, target)
        found.jacobian = found.jacobian * self.correction.derivatives(joint_positions)
        return found


@dataclass(frozen=True, eq=False)
class PoseCorrectedKinematics(ForwardKinematics):
    """Forward kinematics followed by a small motion of the end effector in its own frame.

    The Jacobians are those without the motion, whose derivative is a thousand times smaller than
    the pose's: a refinement takes no more steps.
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
        # The target is reached with the motion where the target moved back is reached without it.
        motion = self.network.motions(joint_positions[np.newaxis])
        moved = _moved(target[np.newaxis], motion, reverse=True)[0]
        return self.kinematics.linearise(joint_positions, moved)


@dataclass(frozen=True, eq=False)
class OneTurn(JointCorrection):
    """Continuous joints in the turn around ``centre`` ``(dof,)``: corrections are known there."""

    centre: FloatArray
    turning: Sequence[int]

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        return unwrapped(joint_positions, self.centre, self.turning)

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        return np.ones_like(joint_positions)


def _moved(poses: FloatArray, motions: FloatArray, *, reverse: bool = False) -> FloatArray:
    """Poses ``(n, 7)`` moved by twists ``(n, 6)`` in their own frames, or back by them.

    The twists are so small that half the cross product is the exponential's coupling of rotation
    and translation, to 1e-9 m.
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
