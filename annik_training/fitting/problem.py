"""What a network learns: inputs and targets as functions of the joint positions."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
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
    positions; for a function that is learned forwards, the inputs are the joint positions. Both
    need only derivatives by the joint positions for Sobolev training: the Jacobian of the forward
    kinematics, never its inverse.
    """

    @property
    def name(self) -> str:
        """Short name."""

    @property
    def joint_box(self) -> JointLimits:
        """Joint positions that the examples are drawn from."""

    @property
    def target_box(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest targets ``(k,)``; the outputs of a network are scaled to them."""

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """Inputs of the network ``(n, m)`` at joint positions ``(n, dof)``."""

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """Targets of the network ``(n, k)``."""

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the inputs ``(n, m, dof)``."""

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the targets ``(n, k, dof)``."""


@dataclass(frozen=True)
class InverseKinematicsSystem:
    """The inverse kinematics of a robot as a :class:`System`."""

    robot: Robot

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.robot.name

    @property
    def joint_box(self) -> JointLimits:
        """Joint box of the robot."""
        return self.robot.joint_box

    @property
    def target_box(self) -> tuple[FloatArray, FloatArray]:
        """Joint box of the robot."""
        return self.robot.joint_box.lower, self.robot.joint_box.upper

    @cached_property
    def encoding(self) -> PoseEncoding:
        """Encoding of poses as features: the paper's for its gantry."""
        workspace = self.robot.workspace
        if isinstance(workspace, GantryWorkspace):
            return PositionRollPitchYaw(0.5 * (workspace.lower[3:] + workspace.upper[3:]))
        return PositionRotationMatrix()

    def features(self, poses: FloatArray, joint_positions: FloatArray) -> FloatArray:
        """Features ``(n, m)`` of poses ``(n, 7)``.

        Where a pose has several solutions, the example's joint positions choose, as the previous
        command does in the solver.
        """
        workspace = self.robot.workspace
        resolved = [
            workspace.resolve(pose, workspace.reference(example)).pose
            for pose, example in zip(poses, joint_positions, strict=True)
        ]
        return self.encoded(np.array(resolved))

    def encoded(self, poses: FloatArray) -> FloatArray:
        """Features ``(n, m)`` of resolved poses ``(n, 7)``."""
        with torch.no_grad():
            features: FloatArray = self.encoding(torch.from_numpy(poses)).numpy()
        return features

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """Features of the poses that the forward kinematics gives."""
        return self.features(self.robot.forward_kinematics.poses(joint_positions), joint_positions)

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """The joint positions."""
        return joint_positions

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the features.

        Those of the gantry's task coordinates are eq. (1)-(2). Those of an arm's position and
        rotation matrix come from the geometric Jacobian in the base frame: each column of the
        matrix changes by the cross product of the angular velocity with it.
        """
        kinematics = self.robot.forward_kinematics
        if isinstance(kinematics, GantryKinematics):
            return np.tile(np.diag(kinematics.ratio), (len(joint_positions), 1, 1))
        jacobians = kinematics.jacobians(joint_positions)
        quaternions = kinematics.poses(joint_positions)[:, 3:]
        # (n, 3, column): the axes of the end effector.
        axes = Rotation.from_quat(quaternions).as_matrix()
        # (n, dof, column, 3): angular velocity of each joint, cross each axis.
        turning = np.cross(
            jacobians[:, 3:].transpose(0, 2, 1)[:, :, np.newaxis],
            axes.transpose(0, 2, 1)[:, np.newaxis],
        )
        examples, dof = joint_positions.shape
        columns = turning.reshape(examples, dof, 9).transpose(0, 2, 1)
        return np.concatenate([jacobians[:, :3], columns], axis=1)

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """The identity, as network(encode(forward(q))) = q."""
        return np.tile(np.eye(self.robot.dof), (len(joint_positions), 1, 1))
