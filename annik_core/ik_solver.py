"""Inverse kinematics by a trained network, every answer verified by the forward kinematics."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from annik_core.acceptance import AcceptanceLimits, joint_step_violation, residual_violation
from annik_core.artifact import ModelArtifact, load_artifact
from annik_core.errors import NonFiniteValue, NotUnitQuaternion
from annik_core.ik_result import IkResult, IkStatus
from annik_core.pose import FloatArray, checked_pose, pose_difference
from annik_core.robot import Robot


@dataclass(frozen=True, eq=False)
class IkSolver:
    """Turns target poses into joint positions, in a fixed number of operations.

    The checks run in this order, and the first that fails is the answer: finite numbers, unit
    quaternion, workspace, network, joint limits, residual, joint step. They see exactly the joint
    positions that are returned; nothing is clamped.

    Attributes:
        artifact: the trained network and the robot that it is for.
        limits: what an answer must satisfy.
    """

    artifact: ModelArtifact
    limits: AcceptanceLimits = AcceptanceLimits()

    @classmethod
    def from_file(cls, path: str | Path, limits: AcceptanceLimits | None = None) -> IkSolver:
        """The solver for a model file.

        Raises:
            ArtifactError: if the file can't be used; see :mod:`annik_core.errors`.
        """
        return cls(load_artifact(path), limits or AcceptanceLimits())

    @property
    def robot(self) -> Robot:
        """The robot that the model was trained for."""
        return self.artifact.robot

    def solve(self, pose: ArrayLike, previous: IkResult | FloatArray | None = None) -> IkResult:
        """Joint positions that reach one pose.

        Args:
            pose: ``(7,)`` x, y, z [m], unit quaternion x, y, z, w, in the robot's base frame.
            previous: the accepted answer to the target before, or, at first, the joint positions
                ``(dof,)`` [rad or m] where the robot is. The joint step is measured from it, and
                where the pose leaves a choice the answer stays close to it.

        Returns:
            The answer or the refusal. Never raises for a bad target of seven numbers.

        Raises:
            WrongShape: if ``pose`` is not seven numbers.
        """
        try:
            target = checked_pose(pose)
        except NonFiniteValue as error:
            return IkResult.refused(IkStatus.NOT_FINITE, str(error))
        except NotUnitQuaternion as error:
            return IkResult.refused(IkStatus.NOT_UNIT_QUATERNION, str(error))
        reference, previous_positions = self._remembered(previous)
        resolved = self.robot.workspace.resolve(target, reference)
        if resolved.violation is not None:
            return IkResult.refused(IkStatus.OUTSIDE_WORKSPACE, resolved.violation)
        joint_positions = self.artifact.joint_positions(resolved.pose[np.newaxis])[0]
        result = self._accepted_or_refused(target, joint_positions, previous_positions)
        return replace(result, reference=resolved.reference) if result.accepted else result

    def solve_batch(self, poses: ArrayLike) -> list[IkResult]:
        """Answers to many poses ``(n, 7)``, each on its own, as :meth:`solve` gives them."""
        return [self.solve(pose) for pose in np.asarray(poses, dtype=np.float64)]

    def _remembered(
        self, previous: IkResult | FloatArray | None
    ) -> tuple[FloatArray | None, FloatArray | None]:
        """Reference and joint positions of what came before."""
        if previous is None:
            return None, None
        if isinstance(previous, IkResult):
            return previous.reference, previous.joint_positions
        return self.robot.workspace.reference(previous), previous

    def _accepted_or_refused(
        self, target: FloatArray, joint_positions: FloatArray, previous: FloatArray | None
    ) -> IkResult:
        violation = self.robot.joint_limits.violation(joint_positions)
        if violation is not None:
            return IkResult.refused(IkStatus.JOINT_LIMIT, violation)
        achieved = self.robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]
        position, rotation = pose_difference(target, achieved)
        position_residual = math.hypot(*position)
        orientation_residual = math.hypot(*rotation)
        violation = residual_violation(position_residual, orientation_residual, self.limits)
        if violation is not None:
            return IkResult.refused(
                IkStatus.RESIDUAL_TOO_LARGE, violation, position_residual, orientation_residual
            )
        if previous is not None:
            violation = joint_step_violation(
                self.robot.joint_names, joint_positions, previous, self.limits
            )
            if violation is not None:
                return IkResult.refused(
                    IkStatus.JOINT_STEP_TOO_LARGE,
                    violation,
                    position_residual,
                    orientation_residual,
                )
        joint_positions.flags.writeable = False
        return IkResult(
            IkStatus.SUCCESS, joint_positions, position_residual, orientation_residual, 0, ""
        )
