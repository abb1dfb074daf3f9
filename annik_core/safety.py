"""What a command must satisfy: its limits, and every check on it, in order.

A solution becomes a command if none of :data:`COMMAND_CHECKS` refuses it. A new check is a member
of :class:`IkStatus` and a function in that tuple, both at the same place in the order.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from annik_core.errors import InvalidValue
from annik_core.pose import POSE_FIELDS, FloatArray, Numbers, rotation_matrix
from annik_core.robots.robot import Robot
from annik_core.robots.task import Task
from annik_core.settings import CheckedSettings, check_settings, setting, upper_limit


class IkStatus(Enum):
    """Outcome of one target, in the order of the checks.

    Everything but ``SUCCESS`` is a refusal: nothing is commanded. docs/ros_interface.md says when.
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
    BRANCH_ENDS = "branch ends"
    JOINT_LIMIT = "joint limit"
    RESIDUAL_TOO_LARGE = "residual too large"
    EXPECTED_ERROR_TOO_LARGE = "expected error too large"
    JOINT_STEP_TOO_LARGE = "joint step too large"
    JOINT_VELOCITY_TOO_LARGE = "joint velocity too large"
    FIRST_COMMAND_TOO_FAR = "first command too far"
    TOO_FAR_FROM_MEASURED = "too far from measured"
    SOLVER_FAILED = "solver failed"


class Refusal(NamedTuple):
    """Why a target is refused."""

    status: IkStatus
    reason: str


@dataclass(frozen=True)
class AcceptanceLimits(CheckedSettings):
    """Limits that a solution must satisfy to be commanded; infinity: no limit.

    Raises:
        InvalidValue: if a limit is NaN, zero or negative.
    """

    max_position_residual: float = upper_limit(
        1e-3,
        "Largest distance from the target to the pose of a solution; a solution beyond it is "
        "refused.",
        unit="m",
    )
    max_orientation_residual: float = upper_limit(
        5e-3,
        "Largest angle from the target to the pose of a solution; a solution beyond it is "
        "refused.",
        unit="rad",
    )
    max_joint_step: float = upper_limit(
        math.inf,
        "Largest change of any joint from the previous command, or of the first command from the "
        "measured joint positions; a solution beyond it is refused.",
        unit="rad or m",
    )
    max_expected_error: float = upper_limit(
        math.inf,
        "With a calibrated robot: largest expected position error of the forward kinematics, a "
        "bound that 95 of 100 poses stay below; a solution beyond it is refused.",
        unit="m",
    )
    max_expected_orientation_error: float = upper_limit(
        math.inf,
        "With a calibrated robot: largest expected orientation error, likewise.",
        unit="rad",
    )

    @cached_property
    def limits_expected_errors(self) -> bool:
        """Whether an expected error can be too large."""
        limits = self.max_expected_error, self.max_expected_orientation_error
        return not all(map(math.isinf, limits))


class FirstCommandRule(Enum):
    """How the first command after the start is compared with the measured joint positions.

    ``FREE``: it may be anywhere. ``NEAR_IF_MEASURED``: it must be near the measured joint
    positions if there are any. ``NEAR``: without a measurement it is refused.
    """

    FREE = "free"
    NEAR_IF_MEASURED = "near_if_measured"
    NEAR = "near"


@dataclass(frozen=True)
class CommandSafety:
    """Limits on targets and commands; infinity: no limit.

    Raises:
        InvalidValue: if a limit is NaN, zero or negative, or the box is empty.
    """

    workspace_box_lower: tuple[float, ...] = setting(
        (-math.inf,) * 3,
        "Least x, y, z of a target in the base frame; a target beyond is refused.",
        unit="m",
        within=(-math.inf, math.inf),
    )
    workspace_box_upper: tuple[float, ...] = setting(
        (math.inf,) * 3,
        "Greatest x, y, z of a target in the base frame; a target beyond is refused.",
        unit="m",
        within=(-math.inf, math.inf),
    )
    max_target_age: float = upper_limit(
        math.inf,
        "Largest difference of the stamp of a target from the present time, past or future; a "
        "target beyond it is refused, and so is a stamped target whose stamp is 0.",
        unit="s",
    )
    max_joint_velocity: float = upper_limit(
        math.inf,
        "Largest change of any joint from the previous command, divided by the time since then; a "
        "command beyond it is refused.",
        unit="rad/s or m/s",
    )
    expected_rate: float = setting(
        0.0,
        "Expected rate of targets. A lower rate is a diagnostic warning; at a higher rate "
        "max_joint_velocity takes commands to be 1 / expected_rate apart. 0: unknown.",
        unit="Hz",
        within=(0.0, 100_000.0),
    )
    max_measured_step: float = upper_limit(
        math.inf,
        "Largest distance of any joint of a command from its measured position, if joint_states "
        "are received; a command beyond it is refused.",
        unit="rad or m",
    )
    first_command: FirstCommandRule = setting(
        FirstCommandRule.NEAR_IF_MEASURED,
        "Whether max_first_step limits the first command after an activation. near_if_measured: "
        "if joint_states are received; near: always, and without joint_states it is refused; "
        "free: never.",
    )
    max_first_step: float = upper_limit(
        0.2,
        "Largest distance of any joint of the first command from its measured position.",
        unit="rad or m",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        pairs = zip(self.workspace_box_lower, self.workspace_box_upper, strict=True)
        if not all(low < high for low, high in pairs):
            raise InvalidValue(
                "workspace_box_lower",
                self.workspace_box_lower,
                f"less than workspace_box_upper, {self.workspace_box_upper}, in x, y and z",
            )

    @property
    def shortest_interval(self) -> float:
        """Least time that commands are taken to be apart [s]; 0 if the rate is unknown."""
        return 1.0 / self.expected_rate if self.expected_rate > 0 else 0.0

    @cached_property
    def has_workspace_box(self) -> bool:
        """Whether the box leaves anything out."""
        return any(map(math.isfinite, (*self.workspace_box_lower, *self.workspace_box_upper)))


#: Error or residual of which nothing is known: position [m], orientation [rad].
UNKNOWN = (math.nan, math.nan)


@dataclass(eq=False, slots=True)
class Candidate:
    """Joint positions that become a command unless a check refuses them.

    Attributes:
        target: ``(7,)`` a checked pose.
        joint_positions: ``(dof,)`` [rad or m], exactly the array that is returned.
        known_residuals: the residuals, as far as computed; see :meth:`residuals`.
        converged: False if the refinement ended short of the target.
        not_found: why there is no solution, in place of what is left after the refinement.
        branch_end: why the solution is not on the branch of the previous command; empty if it is.
        task: what of the target must be reached.
    """

    robot: Robot
    target: FloatArray
    joint_positions: FloatArray
    known_residuals: tuple[float, float] = UNKNOWN
    newton_steps: int = 0
    converged: bool = True
    not_found: str = ""
    branch_end: str = ""
    task: Task = Task.POSE
    _expected_errors: tuple[float, float] | None = field(default=None, init=False)

    def residuals(self) -> tuple[float, float]:
        """Distance [m] and angle [rad] to the target, computed when a check first asks."""
        if self.known_residuals is UNKNOWN:
            self.known_residuals = self.robot.forward_kinematics.residuals(
                self.joint_positions, self.target
            )
        return self.known_residuals

    def angle_to_task(self) -> float:
        """Angle [rad] to what of the target's orientation must be reached; 0 if nothing of it."""
        if self.task is Task.POSE:
            return self.residuals()[1]
        if self.task is Task.POSITION:
            return 0.0
        achieved = self.robot.forward_kinematics.poses(self.joint_positions[np.newaxis])[0]
        axes = rotation_matrix(achieved[3:])
        x, y, z = (axes.T @ rotation_matrix(self.target[3:])[:, 2]).tolist()
        return math.atan2(math.hypot(x, y), z)

    def expected_errors(self) -> tuple[float, float]:
        """How far the real robot may be from the model [m], [rad]; NaN if unknown."""
        if self._expected_errors is None:
            bound = self.robot.error_bound
            self._expected_errors = (
                UNKNOWN if bound is None else bound.at(self.robot.in_box(self.joint_positions))
            )
        return self._expected_errors


class Measurement(NamedTuple):
    """Where the robot is, as far as measured.

    Attributes:
        joint_positions: ``(dof,)`` [rad or m], or None if unknown.
        fault: why they are unknown although joint states arrive, as the end of a sentence; None
            if none arrive. With a fault, a check that needs them refuses.
    """

    joint_positions: FloatArray | None = None
    fault: str | None = None


#: Of this nothing is known, and nothing refuses.
NOT_MEASURED = Measurement()


class Motion(NamedTuple):
    """The motion of a running robot that a command continues.

    Attributes:
        interval: time since the previous command [s]; None: this is the first command.
        measured: where the robot is; of a command for a later time nothing is known.
    """

    safety: CommandSafety
    interval: float | None
    measured: Measurement = NOT_MEASURED


class CommandContext(NamedTuple):
    """What a candidate is checked against.

    Attributes:
        previous: ``(dof,)`` the previous command, or, at first, the measured joint positions.
        motion: the motion that it continues; None: it stands alone.
    """

    limits: AcceptanceLimits
    previous: FloatArray | None = None
    motion: Motion | None = None


def check_frame(frame_id: str, base_frame: str) -> Refusal | None:
    """A target must be in the base frame, which an empty ``frame_id`` means too."""
    if not frame_id or frame_id == base_frame:
        return None
    return Refusal(
        IkStatus.WRONG_FRAME,
        f"the target is in frame {frame_id!r}; it must be in {base_frame!r}, "
        "the base frame of the model",
    )


def check_age(age: float | None, safety: CommandSafety) -> Refusal | None:
    """The age of a target [s] must be at most the limit, in both directions; None: no stamp."""
    limit = safety.max_target_age
    if age is None or abs(age) <= limit:
        return None
    if age < 0:
        reason = (
            f"its stamp is {-age:.4g} s in the future, more than {limit:.4g} s: set the clocks"
        )
    else:
        reason = f"it is {age:.4g} s old, more than {limit:.4g} s"
    return Refusal(IkStatus.STALE_TARGET, reason)


def check_path_length(poses: int, most: int) -> Refusal | None:
    """A path must have at least one pose and at most ``most``."""
    if 0 < poses <= most:
        return None
    return Refusal(IkStatus.PATH_LENGTH, f"the path has {poses} poses; it must have 1 to {most}")


def check_workspace_box(pose: Numbers, safety: CommandSafety) -> Refusal | None:
    """The position of a pose ``(7,)`` must be in the workspace box.

    A coordinate that is not finite is left to the check that names it.
    """
    if not safety.has_workspace_box:
        return None
    bounds = zip(pose[:3], safety.workspace_box_lower, safety.workspace_box_upper, strict=True)
    for axis, (value, low, high) in enumerate(bounds):
        if math.isfinite(value) and not low <= value <= high:
            return Refusal(
                IkStatus.OUTSIDE_WORKSPACE_BOX,
                f"{POSE_FIELDS[axis]} is {value:.6g} m; the workspace box allows "
                f"{low:.6g} to {high:.6g} m",
            )
    return None


def check_convergence(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """The refinement must have reached the target."""
    if candidate.converged:
        return None
    reason = candidate.not_found
    if not reason:
        position, orientation = candidate.residuals()
        reason = (
            f"{1e3 * position:.4g} mm and {math.degrees(orientation):.4g} degrees are left after "
            f"{candidate.newton_steps} steps: no solution in the joint box was found"
        )
    return Refusal(IkStatus.NOT_CONVERGED, reason)


def check_branch(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """The solution must be on the branch of the previous command, unless that may change."""
    if not candidate.branch_end:
        return None
    return Refusal(IkStatus.BRANCH_ENDS, candidate.branch_end)


def check_joint_limits(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """Every joint must be inside its limits, which NaN is not."""
    violation = candidate.robot.joint_limits.violation(candidate.joint_positions)
    return None if violation is None else Refusal(IkStatus.JOINT_LIMIT, violation)


def check_residuals(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """The forward kinematics must lead to the target, as far as it must be reached.

    NaN is too large a residual.
    """
    position, orientation = candidate.residuals()[0], candidate.angle_to_task()
    limits = context.limits
    if not position <= limits.max_position_residual:
        reason = (
            f"position residual {1e3 * position:.4g} mm exceeds "
            f"{1e3 * limits.max_position_residual:.4g} mm"
        )
    elif not orientation <= limits.max_orientation_residual:
        reason = (
            f"orientation residual {math.degrees(orientation):.4g} degrees exceeds "
            f"{math.degrees(limits.max_orientation_residual):.4g} degrees"
        )
    else:
        return None
    return Refusal(IkStatus.RESIDUAL_TOO_LARGE, reason)


def check_expected_errors(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """The expected errors must be known and within their limits, where these are finite."""
    limits = context.limits
    if not limits.limits_expected_errors:
        return None
    position, orientation = candidate.expected_errors()
    for what, expected, limit, unit, factor in (
        ("error", position, limits.max_expected_error, "mm", 1e3),
        (
            "orientation error",
            orientation,
            limits.max_expected_orientation_error,
            "degrees",
            math.degrees(1.0),
        ),
    ):
        if math.isinf(limit) or expected <= limit:
            continue
        if math.isnan(expected):
            reason = (
                f"expected {what} is limited to {factor * limit:.4g} {unit}, but is unknown: "
                "the model was not calibrated from measured poses (annik calibrate)"
            )
        else:
            reason = (
                f"expected {what} {factor * expected:.4g} {unit} exceeds "
                f"{factor * limit:.4g} {unit}"
            )
        return Refusal(IkStatus.EXPECTED_ERROR_TOO_LARGE, reason)
    return None


def check_joint_step(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """No joint may move further from the previous command than the limit."""
    previous, limit = context.previous, context.limits.max_joint_step
    if previous is None or math.isinf(limit):
        return None
    excess = largest_step_beyond(limit, candidate.robot, candidate.joint_positions, previous)
    if excess is None:
        return None
    joint, step = excess
    return Refusal(
        IkStatus.JOINT_STEP_TOO_LARGE,
        f"{candidate.robot.joint_names[joint]} would step by {step:.6g}, more than "
        f"{limit:.6g} from the previous command",
    )


def check_joint_velocity(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """No joint may move faster from the previous command than the limit."""
    motion, previous = context.motion, context.previous
    if motion is None or motion.interval is None or previous is None:
        return None
    safety = motion.safety
    if math.isinf(safety.max_joint_velocity):
        return None
    interval = max(motion.interval, safety.shortest_interval)
    # As a product, so that no time at all is no division by zero.
    limit = safety.max_joint_velocity * interval
    excess = largest_step_beyond(limit, candidate.robot, candidate.joint_positions, previous)
    if excess is None:
        return None
    joint, step = excess
    velocity = step / interval if interval > 0 else math.inf
    return Refusal(
        IkStatus.JOINT_VELOCITY_TOO_LARGE,
        f"{candidate.robot.joint_names[joint]} would move by {step:.6g} in {interval:.4g} s, "
        f"{velocity:.6g} per second; at most {safety.max_joint_velocity:.6g} is allowed",
    )


def check_first_command(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """The first command must be near the measured joint positions, as its rule says."""
    motion = context.motion
    if motion is None or motion.interval is not None:
        return None
    safety, _, (measured, fault) = motion
    if safety.first_command is FirstCommandRule.FREE:
        return None
    if measured is None:
        if fault is not None:
            reason = f"{fault}, and the first command must be near the robot: mend joint_states"
            remedy = "set first_command to free"
        elif safety.first_command is FirstCommandRule.NEAR:
            reason = (
                "where the robot is has not been measured, and the first command must be near it: "
                "publish joint_states"
            )
            remedy = "set first_command to near_if_measured"
        else:
            return None
        return Refusal(IkStatus.FIRST_COMMAND_TOO_FAR, f"{reason}, or {remedy}")
    violation = measured_violation(
        candidate.robot, candidate.joint_positions, measured, safety.max_first_step
    )
    return None if violation is None else Refusal(IkStatus.FIRST_COMMAND_TOO_FAR, violation)


def check_measured_step(candidate: Candidate, context: CommandContext) -> Refusal | None:
    """No joint may be sent further from its measured position than the limit."""
    motion = context.motion
    if motion is None or math.isinf(motion.safety.max_measured_step):
        return None
    measured, fault = motion.measured
    if measured is None:
        if fault is None:
            return None
        reason = f"{fault}, and max_measured_step limits the distance from the robot"
        return Refusal(IkStatus.TOO_FAR_FROM_MEASURED, reason)
    violation = measured_violation(
        candidate.robot, candidate.joint_positions, measured, motion.safety.max_measured_step
    )
    return None if violation is None else Refusal(IkStatus.TOO_FAR_FROM_MEASURED, violation)


Check = Callable[[Candidate, CommandContext], Refusal | None]

#: The checks of a solution by itself, and those of the motion to it.
_OWN_CHECKS: tuple[Check, ...] = (
    check_convergence,
    check_branch,
    check_joint_limits,
    check_residuals,
    check_expected_errors,
)
MOTION_CHECKS: tuple[Check, ...] = (
    check_joint_step,
    check_joint_velocity,
    check_first_command,
    check_measured_step,
)
#: The checks on a solution, in the order of :class:`IkStatus`; each runs once, and the first that
#: refuses ends them. Those of the target come before: frame, age, path length, workspace box
#: (above), numbers (:func:`annik_core.pose.checked_pose`) and the robot's workspace.
COMMAND_CHECKS: tuple[Check, ...] = (*_OWN_CHECKS, *MOTION_CHECKS)


def surely_accepted(
    robot: Robot,
    limits: AcceptanceLimits,
    joint_positions: FloatArray,
    residuals: FloatArray,
    converged: NDArray[np.bool_],
    expected_errors: FloatArray,
) -> NDArray[np.bool_]:
    """Which rows none of :data:`COMMAND_CHECKS` refuses, without previous command or motion.

    Of n candidates: joint positions ``(n, dof)``, residuals and expected errors ``(n, 2)`` [m],
    [rad]. A check that is new must be here too; what is not certain is left to the checks.
    """
    lower, upper = robot.joint_limits.lower, robot.joint_limits.upper
    inside = (joint_positions >= lower) & (joint_positions <= upper)
    near = residuals <= [limits.max_position_residual, limits.max_orientation_residual]
    accepted: NDArray[np.bool_] = converged & inside.all(axis=1) & near.all(axis=1)
    if limits.limits_expected_errors:
        largest = [limits.max_expected_error, limits.max_expected_orientation_error]
        # Infinite limits do not refuse what is unknown.
        accepted &= (np.isinf(largest) | (expected_errors <= largest)).all(axis=1)
    return accepted


def measured_violation(
    robot: Robot, joint_positions: FloatArray, measured: FloatArray, limit: float
) -> str | None:
    """Why joint positions ``(dof,)`` are further than ``limit`` [rad or m] from the measured."""
    excess = largest_step_beyond(limit, robot, joint_positions, measured)
    if excess is None:
        return None
    joint, step = excess
    return (
        f"{robot.joint_names[joint]} would go to {joint_positions[joint]:.6g}, but is measured at "
        f"{measured[joint]:.6g}: {step:.6g} away, more than {limit:.6g}"
    )


def largest_step_beyond(
    limit: float, robot: Robot, joint_positions: FloatArray, reference: FloatArray
) -> tuple[int, float] | None:
    """Which joint is furthest from ``reference``, both ``(dof,)``, and by how much [rad or m].

    None if no joint is further than ``limit``; if that is infinite, nothing is compared. A
    continuous joint is at the same place after a full turn.
    """
    if math.isinf(limit):
        return None
    steps = np.abs(robot.difference(joint_positions, reference))
    if (steps <= limit).all():
        return None
    joint = int(np.argmax(steps))
    return joint, float(steps[joint])
