"""A robot: joints, limits, frames, forward kinematics, workspace."""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from annik_core.errors import WrongShape
from annik_core.pose import FloatArray, Numbers, rotation_matrix, single_pose_difference
from annik_core.robots.joint_limits import JointLimits

if TYPE_CHECKING:
    from annik_core.robots.corrections import ErrorBound


@dataclass(eq=False, slots=True)
class Linearisation:
    """Pose error to a target at some joint positions, and its derivative.

    All in the axes of the end-effector frame (body twist, body Jacobian), linear rows first. To
    first order, a joint motion ``dq`` reduces ``twist`` by ``jacobian @ dq``.

    Attributes:
        twist: ``(6,)`` motion of the end effector that reaches the target [m], [rad]. For an arm,
            the logarithm of the relative pose (SE(3)); for the gantry, displacement and rotation
            vector, which is the same to first order.
        jacobian: ``(6, dof)``.
        displacement: ``(3,)`` from the end effector to the target [m].
    """

    twist: FloatArray
    jacobian: FloatArray
    displacement: FloatArray

    @property
    def distance(self) -> float:
        """Norm of the twist, metres and radians together."""
        return float(np.linalg.norm(self.twist))

    @property
    def residuals(self) -> tuple[float, float]:
        """Distance [m] and angle [rad] to the target."""
        return math.hypot(*self.displacement.tolist()), math.hypot(*self.twist[3:].tolist())


class ForwardKinematics(Protocol):
    """Pose and Jacobian of the end effector as functions of the joint positions."""

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """End-effector poses ``(n, 7)`` in the base frame for joint positions ``(n, dof)``."""
        ...

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Geometric Jacobians ``(n, 6, dof)`` for joint positions ``(n, dof)``.

        In the axes of the base frame: rows 0-2 are the linear, rows 3-5 the angular velocity of
        the end effector per unit of joint velocity.
        """
        ...

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """Error to one target pose ``(7,)`` and its derivative at joint positions ``(dof,)``."""
        achieved = self.poses(joint_positions[np.newaxis])[0]
        position, rotation = single_pose_difference(target, achieved)
        # From the base frame's axes to the end effector's.
        axes = rotation_matrix(achieved[3:]).T
        displacement = axes @ position
        jacobian = self.jacobians(joint_positions[np.newaxis])[0]
        return Linearisation(
            np.concatenate([displacement, axes @ rotation]),
            np.concatenate([axes @ jacobian[:3], axes @ jacobian[3:]]),
            displacement,
        )

    def residuals(self, joint_positions: FloatArray, target: FloatArray) -> tuple[float, float]:
        """Distance [m] and angle [rad] to one target pose ``(7,)`` at joint positions."""
        return self.linearise(joint_positions, target).residuals


FULL_TURN = 2.0 * math.pi
#: Rounding of the ends of a turn [rad].
TURN_TOLERANCE = 1e-9


def turning_joints(joint_types: Sequence[str]) -> list[int]:
    """Indices of the continuous joints."""
    return [joint for joint, kind in enumerate(joint_types) if kind == "continuous"]


def unwrapped(
    joint_positions: FloatArray, reference: FloatArray | float, turning: Sequence[int]
) -> FloatArray:
    """Joint positions ``(..., dof)``, the joints ``turning`` within half a turn of a reference."""
    if not turning:
        return joint_positions
    away = (joint_positions - reference)[..., turning]
    nearest = joint_positions.copy()
    nearest[..., turning] -= FULL_TURN * np.round(away / FULL_TURN)
    return nearest


#: The reference of a robot whose poses leave no choice.
NO_REFERENCE: tuple[float, ...] = ()


class ResolvedTarget(NamedTuple):
    """A target as the network should see it, and whether it is in the workspace.

    Attributes:
        pose: ``(7,)`` the target; or, at a singularity where several joint positions reach it, a
            pose within 20 micro-radians that only one of them reaches.
        violation: what is outside which bound, or None if the target is in the workspace.
        reference: which of several solutions is meant; see :class:`Workspace`.
    """

    pose: FloatArray
    violation: str | None
    reference: Numbers


class Workspace(Protocol):
    """The poses that the robot is meant to reach.

    Where a pose leaves a choice between joint positions, a *reference* selects one of them; its
    meaning is private to the workspace. Each resolved target gives the reference for the next,
    which is exact: the network's errors do not add up while the robot holds a pose.
    """

    def resolve(self, pose: FloatArray, reference: Numbers | None) -> ResolvedTarget:
        """Check a target ``(7,)``; where it leaves a choice, resolve it close to ``reference``."""
        ...

    def plainly_inside(self, poses: FloatArray) -> NDArray[np.bool_]:
        """Which checked poses ``(n, 7)`` :meth:`resolve` certainly gives back as they are, inside.

        The reference is empty for these.
        """
        ...

    def reference(self, joint_positions: FloatArray) -> Numbers:
        """The reference that selects these joint positions ``(dof,)``."""
        ...


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot, as read from its definition. Lengths in metres, angles in radians.

    Attributes:
        joint_types: ``revolute``, ``continuous`` or ``prismatic``, one per joint. A continuous
            joint is at the same place after a full turn, whatever turns its position counts.
        joint_limits: limits of the joint positions; a command is never outside.
        joint_box: the part of them that the network is trained for and solutions are in, those of
            continuous joints after some full turns.
        error_bound: of a calibrated robot, how far it may be from these forward kinematics; None
            if unknown.
        masses: of an arm's links [kg], ``(dof,)``, at the places of
            :class:`annik_core.robots.corrections.Deflection`; None if its URDF has none. They are
            no part of the definition.
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
    error_bound: "ErrorBound | None" = None
    masses: tuple[float, ...] | None = None

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @cached_property
    def turning(self) -> list[int]:
        """Indices of the continuous joints."""
        return turning_joints(self.joint_types)

    def difference(self, to: FloatArray, start: FloatArray) -> FloatArray:
        """``to - start``, each ``(..., dof)``; of a continuous joint the shorter way around."""
        return unwrapped(to - start, 0.0, self.turning)

    def unwrapped(self, joint_positions: FloatArray, reference: FloatArray) -> FloatArray:
        """Joint positions ``(..., dof)``, continuous joints within half a turn of a reference."""
        return unwrapped(joint_positions, reference, self.turning)

    def in_box(self, joint_positions: FloatArray) -> FloatArray:
        """Joint positions ``(..., dof)``, continuous joints in the turn around their box."""
        return unwrapped(joint_positions, self.joint_box.centre, self.turning)

    @cached_property
    def search_box(self) -> JointLimits:
        """The joint box; without bounds for a continuous joint that has the full turn in it."""
        box = self.joint_box
        widths = (box.upper - box.lower).tolist()
        whole = [joint for joint in self.turning if widths[joint] >= FULL_TURN - TURN_TOLERANCE]
        if not whole:
            return box
        lower, upper = box.lower.copy(), box.upper.copy()
        lower[whole], upper[whole] = -math.inf, math.inf
        return JointLimits(box.joint_names, lower, upper)

    @cached_property
    def rotary(self) -> NDArray[np.bool_]:
        """Which joints ``(dof,)`` rotate; the others slide."""
        return np.array([kind != "prismatic" for kind in self.joint_types])

    @cached_property
    def has_whole_box(self) -> bool:
        """Whether the joint box leaves out nothing that the limits allow, full turns apart.

        Networks of a calibration are known in the box alone, also where it is a full turn.
        """
        box, limits = self.joint_box, self.joint_limits
        corrections = self.definition.get("corrections") or {}
        learned = any(corrections.get(key) for key in ("joint_networks", "pose_network"))
        kinds = {"continuous"} if learned else {"continuous", "revolute"}
        turns = np.array([kind in kinds for kind in self.joint_types])
        width = limits.upper - limits.lower
        width = np.where(turns, np.minimum(width, FULL_TURN), width)
        return bool((box.upper - box.lower >= width - TURN_TOLERANCE).all())

    @cached_property
    def definition_hash(self) -> str:
        """SHA-256 of the definition: equal for equal robots."""
        return _sha256(self.definition)

    @property
    def nominal_definition(self) -> Mapping[str, Any]:
        """The definition without the corrections of a calibration."""
        return {key: entry for key, entry in self.definition.items() if key != "corrections"}

    @cached_property
    def nominal_hash(self) -> str:
        """SHA-256 of :attr:`nominal_definition`: equal before and after a calibration."""
        return _sha256(self.nominal_definition)


def _sha256(definition: Mapping[str, Any]) -> str:
    text = json.dumps(definition, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def check_joint_count(joint_positions: FloatArray, joint_names: tuple[str, ...]) -> None:
    """Refuse an array that is not ``(n, dof)``, as :class:`WrongShape`."""
    if joint_positions.ndim != 2 or joint_positions.shape[1] != len(joint_names):
        expected = f"(n, {len(joint_names)}), one column for each of {', '.join(joint_names)}"
        raise WrongShape("joint positions", joint_positions.shape, expected)
