"""What annik knows of a robot: joints, limits, frames, forward kinematics, workspace."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

from annik_core.errors import WrongJointCount
from annik_core.joint_limits import JointLimits
from annik_core.pose import FloatArray


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


class ResolvedTarget(NamedTuple):
    """A target as the network should see it, and whether the workspace holds it.

    Attributes:
        pose: ``(7,)``. The target itself, or, where several joint positions reach the same pose
            (a singularity of the robot's orientation axes), a pose within 20 micro-radians of
            it that only one of them reaches.
        violation: what is outside which bound, or None if the target is in the workspace.
    """

    pose: FloatArray
    violation: str | None


class Workspace(Protocol):
    """The poses that the robot is meant to reach."""

    def resolve(self, pose: FloatArray, previous: FloatArray | None) -> ResolvedTarget:
        """Check a target ``(7,)`` and make it unambiguous.

        Args:
            pose: a checked pose.
            previous: joint positions ``(dof,)`` to stay close to where the pose leaves a choice.
        """
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

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @cached_property
    def definition_hash(self) -> str:
        """SHA-256 of the definition, to recognise the robot by: two equal robots, one hash."""
        text = json.dumps(self.definition, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def check_joint_count(joint_positions: FloatArray, joint_names: tuple[str, ...]) -> None:
    """Refuse an array that is not ``(n, dof)``.

    Raises:
        WrongJointCount: naming the joints.
    """
    if joint_positions.ndim != 2 or joint_positions.shape[1] != len(joint_names):
        raise WrongJointCount(joint_positions.shape, joint_names)
