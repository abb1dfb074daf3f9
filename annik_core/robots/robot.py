"""What annik knows of a robot: joints, limits, frames, forward kinematics, workspace."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from annik_core.pose import FloatArray, Numbers, rotation_matrix, single_pose_difference
from annik_core.robots.errors import WrongJointCount
from annik_core.robots.joint_limits import JointLimits

if TYPE_CHECKING:
    from annik_core.robots.corrections import ErrorBound


class Linearisation(NamedTuple):
    """The error to a target at some joint positions, and how joint motion changes it.

    Everything is expressed in the axes of the end-effector frame, linear rows before angular ones.
    To first order, a joint motion ``dq`` takes ``jacobian @ dq`` off ``twist``.

    Attributes:
        twist: ``(6,)`` the motion of the end effector that reaches the target [m], [rad]. For an
            arm it is the body twist, the logarithm of the motion from the one frame to the other;
            for the gantry its linear part is ``displacement``, which is the same to first order.
        jacobian: ``(6, dof)`` the body Jacobian, per unit of joint velocity.
        displacement: ``(3,)`` from the end effector to the target's position [m].
    """

    twist: FloatArray
    jacobian: FloatArray
    displacement: FloatArray

    @property
    def distance(self) -> float:
        """Norm of the twist, in metres and radians."""
        return float(np.linalg.norm(self.twist))

    @property
    def residuals(self) -> tuple[float, float]:
        """Distance [m] and angle [rad] to the target."""
        return math.hypot(*self.displacement.tolist()), math.hypot(*self.twist[3:].tolist())


class ForwardKinematics(Protocol):
    """Where the end effector is, given the joint positions. Batched."""

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """End-effector poses ``(n, 7)`` in the base frame for joint positions ``(n, dof)``."""
        ...

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Geometric Jacobians ``(n, 6, dof)`` for joint positions ``(n, dof)``.

        Rows 0-2 are the linear, rows 3-5 the angular velocity of the end effector, both in the
        base frame, per unit of joint velocity.
        """
        ...

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """The error to one target pose ``(7,)`` at joint positions ``(dof,)``.

        By :meth:`poses` and :meth:`jacobians`, where a robot knows no quicker way.
        """
        achieved = self.poses(joint_positions[np.newaxis])[0]
        position, rotation = single_pose_difference(target, achieved)
        # Rows: the axes of the end-effector frame in the base frame.
        axes = rotation_matrix(achieved[3:]).T
        displacement = axes @ position
        jacobian = self.jacobians(joint_positions[np.newaxis])[0]
        return Linearisation(
            np.concatenate([displacement, axes @ rotation]),
            np.concatenate([axes @ jacobian[:3], axes @ jacobian[3:]]),
            displacement,
        )

    def residuals(self, joint_positions: FloatArray, target: FloatArray) -> tuple[float, float]:
        """Distance [m] and angle [rad] to one target pose ``(7,)`` at joint positions ``(dof,)``.

        Those of :meth:`linearise`, where a robot knows no quicker way.
        """
        return self.linearise(joint_positions, target).residuals


class ResolvedTarget(NamedTuple):
    """A target as the network should see it, and whether the workspace holds it.

    Attributes:
        pose: ``(7,)``. The target itself, or, where several joint positions reach the same pose
            (a singularity of the robot's orientation axes), a pose within 20 micro-radians of
            it that only one of them reaches.
        violation: what is outside which bound, or None if the target is in the workspace.
        reference: which of several solutions is meant; see :class:`Workspace`.
    """

    pose: FloatArray
    violation: str | None
    reference: Numbers


class Workspace(Protocol):
    """The poses that the robot is meant to reach.

    Where a pose leaves a choice between joint positions, a *reference* says which are meant:
    numbers whose meaning only the workspace knows. Each resolved target gives the reference for
    the next. It is exact, unlike the network's answer, by which small errors would add up while
    the robot holds one pose.
    """

    def resolve(self, pose: FloatArray, reference: Numbers | None) -> ResolvedTarget:
        """Check a target ``(7,)`` and make it unambiguous.

        Args:
            pose: a checked pose.
            reference: what to stay close to where the pose leaves a choice, if anything.
        """
        ...

    def reference(self, joint_positions: FloatArray) -> FloatArray:
        """The reference by which these joint positions ``(dof,)`` are the ones meant."""
        ...


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot, as read from its definition. Lengths in metres, angles in radians.

    Attributes:
        name: short name, such as ``gantry``.
        kind: which kind of kinematics the definition describes.
        joint_names: the joints, in the order of every joint-position array.
        joint_types: ``revolute`` or ``prismatic``, one per joint.
        joint_limits: what the joints can do; a command is never outside.
        joint_box: the part of it that examples are drawn from and the network is trained for.
        base_frame: the frame of every pose.
        end_effector_frame: the frame whose pose it is.
        forward_kinematics: see :class:`ForwardKinematics`.
        workspace: see :class:`Workspace`.
        definition: the whole definition, as plain data; a model file carries it.
        error_bound: how far the real robot may be from these forward kinematics, if they were
            learned from it; None if nobody knows.
    """

    name: str
    kind: str
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    joint_limits: JointLimits
    joint_box: JointLimits
    base_frame: str
    end_effector_frame: str
    forward_kinematics: ForwardKinematics
    workspace: Workspace
    definition: Mapping[str, Any]
    error_bound: ErrorBound | None = None

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @cached_property
    def definition_hash(self) -> str:
        """SHA-256 of the definition, to recognise the robot by: two equal robots, one hash."""
        return _sha256(self.definition)

    @property
    def nominal_definition(self) -> Mapping[str, Any]:
        """The definition without what was learned of the robot."""
        return {key: entry for key, entry in self.definition.items() if key != "corrections"}

    @cached_property
    def nominal_hash(self) -> str:
        """SHA-256 of that: one robot as described, and as learned today and tomorrow, one hash."""
        return _sha256(self.nominal_definition)


def _sha256(definition: Mapping[str, Any]) -> str:
    text = json.dumps(definition, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def check_joint_count(joint_positions: FloatArray, joint_names: tuple[str, ...]) -> None:
    """Refuse an array that is not ``(n, dof)``.

    Raises:
        WrongJointCount: naming the joints.
    """
    if joint_positions.ndim != 2 or joint_positions.shape[1] != len(joint_names):
        raise WrongJointCount(joint_positions.shape, joint_names)
