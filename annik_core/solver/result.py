"""What the solver answers: a value for every target, whether it was accepted or refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from annik_core.pose import QUATERNION_NORM_TOLERANCE, FloatArray, Numbers


class IkStatus(Enum):
    """Outcome of one target. Everything but ``SUCCESS`` is a refusal: nothing is commanded.

    In the order of the checks.
    """

    SUCCESS = "success"
    NOT_ACTIVE = "not active"
    MALFORMED_MESSAGE = "malformed message"
    WRONG_FRAME = "wrong frame"
    STALE_TARGET = "stale target"
    PATH_LENGTH = "path length"
    OUTSIDE_WORKSPACE_BOX = "outside workspace box"
    NOT_FINITE = "not finite"
    NOT_UNIT_QUATERNION = "not a unit quaternion"
    OUTSIDE_WORKSPACE = "outside workspace"
    NOT_CONVERGED = "not converged"
    JOINT_LIMIT = "joint limit"
    RESIDUAL_TOO_LARGE = "residual too large"
    EXPECTED_ERROR_TOO_LARGE = "expected error too large"
    JOINT_STEP_TOO_LARGE = "joint step too large"
    JOINT_VELOCITY_TOO_LARGE = "joint velocity too large"
    FIRST_COMMAND_TOO_FAR = "first command too far"
    TOO_FAR_FROM_MEASURED = "too far from measured"
    SOLVER_FAILED = "solver failed"


#: What each refusal means, in one line.
REFUSALS: dict[IkStatus, str] = {
    IkStatus.NOT_ACTIVE: "the node is configured, but not active",
    IkStatus.MALFORMED_MESSAGE: "the bytes are not those of a message of this type, or its stamp "
    "has a second or more of nanoseconds",
    IkStatus.WRONG_FRAME: "frame_id is neither empty nor the base frame",
    IkStatus.STALE_TARGET: "the stamp is further from now than max_target_age",
    IkStatus.PATH_LENGTH: "a path has no pose, or more than max_path_poses",
    IkStatus.OUTSIDE_WORKSPACE_BOX: "the position is outside workspace_box_lower and _upper",
    IkStatus.NOT_FINITE: "a number is NaN or infinite",
    IkStatus.NOT_UNIT_QUATERNION: "the quaternion's norm is not 1 within "
    f"{QUATERNION_NORM_TOLERANCE:g}",
    IkStatus.OUTSIDE_WORKSPACE: "the robot can't reach the pose",
    IkStatus.NOT_CONVERGED: "refined mode found no joint positions in the working joint box",
    IkStatus.JOINT_LIMIT: "the network's answer is outside the joint limits",
    IkStatus.RESIDUAL_TOO_LARGE: "the answer is further from the target than "
    "max_position_residual or max_orientation_residual",
    IkStatus.EXPECTED_ERROR_TOO_LARGE: "the robot may be further from where the learned model has "
    "it than max_expected_error or max_expected_orientation_error, or nobody knows how far",
    IkStatus.JOINT_STEP_TOO_LARGE: "a joint would move by more than max_joint_step",
    IkStatus.JOINT_VELOCITY_TOO_LARGE: "a joint would move faster than max_joint_velocity",
    IkStatus.FIRST_COMMAND_TOO_FAR: "the first command is further than max_first_step from the "
    "measured joint positions, or there are none and first_command is near",
    IkStatus.TOO_FAR_FROM_MEASURED: "the command is further than max_measured_step from the "
    "measured joint positions",
    IkStatus.SOLVER_FAILED: "an error that nobody foresaw",
}


@dataclass(frozen=True, eq=False)
class IkResult:
    """Answer to one target pose.

    Attributes:
        status: the outcome.
        joint_positions: ``(dof,)`` [rad or m], in the order of the robot's joint names, or None if
            the target was refused. Read-only.
        position_residual: distance between the target and the pose that the forward kinematics
            gives for exactly these joint positions [m]; NaN if it was refused before that.
        orientation_residual: angle between the two orientations [rad]; NaN likewise.
        newton_steps: refinement steps taken; 0 in network mode.
        reason: one line saying why it was refused, with the value and the allowed range; empty on
            success.
        target: ``(7,)`` as it was checked, its quaternion normalised; None if refused.
        reference: what to give the workspace with the next target, so that it stays on this
            solution where the pose leaves a choice; None if refused.
        expected_position_error: if the forward kinematics were learned from measured poses, how
            far from theirs the robot's own pose may be [m], so that it is nearer for 95 of 100
            poses; NaN if nobody knows, or refused.
        expected_orientation_error: likewise the angle [rad].
    """

    status: IkStatus
    joint_positions: FloatArray | None
    position_residual: float
    orientation_residual: float
    newton_steps: int
    reason: str
    target: FloatArray | None = None
    reference: Numbers | None = None
    expected_position_error: float = math.nan
    expected_orientation_error: float = math.nan

    @property
    def accepted(self) -> bool:
        """Whether the joint positions may be commanded."""
        return self.status is IkStatus.SUCCESS

    @classmethod
    def refused(
        cls,
        status: IkStatus,
        reason: str,
        position_residual: float = float("nan"),
        orientation_residual: float = float("nan"),
        newton_steps: int = 0,
    ) -> IkResult:
        """A refusal; it carries no joint positions."""
        return cls(status, None, position_residual, orientation_residual, newton_steps, reason)
