"""What a network is fitted to: a system of inputs and targets; inverse kinematics as one.

What can be learned: for joint positions, what a network sees and what it should say.

The inverse kinematics of a robot as a system to learn: from features of the pose to joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.gantry import GantryKinematics, GantryWorkspace
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.networks.encoding import (
    PoseEncoding,
    PositionRollPitchYaw,
    PositionRotationMatrix,
)


class System(Protocol):
    """Inputs and targets of a network as functions of the joint positions. Batched.

    For inverse kinematics the inputs are the features of the pose and the targets are the joint
    positions themselves; for a function to be learned forwards, the inputs are the joint
    positions. Either way a design of experiments chooses joint positions, and the derivatives of
    inputs and targets in them are all that Sobolev training needs: the Jacobian of the forward
    kinematics, and no inverse of it.
    """

    @property
    def name(self) -> str:
        """Short name."""
        ...

    @property
    def joint_box(self) -> JointLimits:
        """Where the examples are drawn from."""
        ...

    @property
    def target_box(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest targets ``(k,)``; the outputs of a network are scaled to them."""
        ...

    @property
    def error_unit(self) -> str:
        """Unit of :meth:`errors`."""
        ...

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """What the network sees ``(n, m)`` at joint positions ``(n, dof)``."""
        ...

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """What it should say ``(n, k)``."""
        ...

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the inputs ``(n, m, dof)``."""
        ...

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the targets ``(n, k, dof)``."""
        ...

    def errors(self, joint_positions: FloatArray, answers: FloatArray) -> FloatArray:
        """How wrong answers ``(n, k)`` are at joint positions ``(n, dof)``: ``(n,)``, 0 if right.

        For inverse kinematics, the distance between where the answers lead and where the joint
        positions do; for a function, the root of the mean square error over its outputs.
        """
        ...


@dataclass(frozen=True)
class InverseKinematicsSystem:
    """See :class:`System`. Errors are distances of the end effector.

    Attributes:
        robot: the robot.
    """

    robot: Robot
    error_unit: str = "mm"

    @property
    def name(self) -> str:
        """The robot's."""
        return self.robot.name

    @property
    def joint_box(self) -> JointLimits:
        """The robot's."""
        return self.robot.joint_box

    @property
    def target_box(self) -> tuple[FloatArray, FloatArray]:
        """The joint box."""
        return self.robot.joint_box.lower, self.robot.joint_box.upper

    @cached_property
    def encoding(self) -> PoseEncoding:
        """How poses become features."""
        workspace = self.robot.workspace
        if not isinstance(workspace, GantryWorkspace):
            return PositionRotationMatrix()
        return PositionRollPitchYaw(0.5 * (workspace.lower[3:] + workspace.upper[3:]))

    def features(self, poses: FloatArray, joint_positions: FloatArray) -> FloatArray:
        """Features ``(n, m)`` of poses ``(n, 7)``.

        Where a pose leaves the choice between several joint positions, it is made unambiguous by
        the example's own, just as the solver does by the previous command.
        """
        workspace = self.robot.workspace
        resolved = [
            workspace.resolve(pose, workspace.reference(example)).pose
            for pose, example in zip(poses, joint_positions, strict=True)
        ]
        with torch.no_grad():
            features: FloatArray = self.encoding(torch.from_numpy(np.array(resolved))).numpy()
        return features

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """Features of the poses that the forward kinematics gives."""
        return self.features(self.robot.forward_kinematics.poses(joint_positions), joint_positions)

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """The joint positions themselves."""
        return joint_positions

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the features.

        The gantry's are its task coordinates, eq. (1)-(2); an arm's are the position, and the
        columns of the rotation matrix, each of which turns with the angular velocity.
        """
        kinematics = self.robot.forward_kinematics
        if isinstance(kinematics, GantryKinematics):
            return np.tile(np.diag(kinematics.ratio), (len(joint_positions), 1, 1))
        jacobians = kinematics.jacobians(joint_positions)
        quaternions = kinematics.poses(joint_positions)[:, 3:]
        # (n, 3, column): the axes of the end effector.
        axes = Rotation.from_quat(quaternions).as_matrix()
        # (n, dof, column, 3): angular velocity by each joint, across each axis.
        turning = np.cross(
            jacobians[:, 3:].transpose(0, 2, 1)[:, :, np.newaxis],
            axes.transpose(0, 2, 1)[:, np.newaxis],
        )
        examples, dof = joint_positions.shape
        columns = turning.reshape(examples, dof, 9).transpose(0, 2, 1)
        return np.concatenate([jacobians[:, :3], columns], axis=1)

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """The identity: network(encode(forward(q))) = q."""
        return np.tile(np.eye(self.robot.dof), (len(joint_positions), 1, 1))

    def errors(self, joint_positions: FloatArray, answers: FloatArray) -> FloatArray:
        """Distances [mm] between where the answers lead and where the joint positions do."""
        forward = self.robot.forward_kinematics
        distances, _ = pose_distance(forward.poses(joint_positions), forward.poses(answers))
        return 1e3 * distances
