"""Checks on a command: acceptance of a solution, and safety limits against the robot's motion.

The checks on an answer, one function each: pure, and told what they need.

What a command must satisfy beyond the solver's own checks, before it may move a robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from annik_core.errors import InvalidValue
from annik_core.pose import POSE_FIELDS, FloatArray, Numbers
from annik_core.settings import check_settings, setting


@dataclass(frozen=True)
class AcceptanceLimits:
    """Limits that a solution must satisfy to be commanded; infinity: no limit.

    Raises:
        InvalidValue: if a limit is NaN, zero or negative.
    """

    max_position_residual: float = setting(
        1e-3,
        "Largest distance from the target to the pose of a solution; a solution beyond it is "
        "refused.",
        unit="m",
        greater_than=0.0,
        maximum=math.inf,
    )
    max_orientation_residual: float = setting(
        5e-3,
        "Largest angle from the target to the pose of a solution; a solution beyond it is "
        "refused.",
        unit="rad",
        greater_than=0.0,
        maximum=math.inf,
    )
    max_joint_step: float = setting(
        math.inf,
        "Largest change of any joint from the previous command, or of the first command from the "
        "measured joint positions; a solution beyond it is refused.",
        unit="rad or m",
        greater_than=0.0,
        maximum=math.inf,
    )
    max_expected_error: float = setting(
        math.inf,
        "With a calibrated robot: largest expected position error of the forward kinematics, a "
        "bound that 95 of 100 poses stay below; a solution beyond it is refused.",
        unit="m",
        greater_than=0.0,
        maximum=math.inf,
    )
    max_expected_orientation_error: float = setting(
        math.inf,
        "With a calibrated robot: largest expected orientation error, likewise.",
        unit="rad",
        greater_than=0.0,
        maximum=math.inf,
    )

    def __post_init__(self) -> None:
        """Refuse limits that no solution, or any solution, could satisfy."""
        check_settings(self)


def residual_violation(
    position_residual: float, orientation_residual: float, limits: AcceptanceLimits
) -> str | None:
    """Why these residuals [m], [rad] are too large, or None. NaN is too large."""
    if not position_residual <= limits.max_position_residual:
        return (
            f"position residual {1e3 * position_residual:.4g} mm exceeds "
            f"{1e3 * limits.max_position_residual:.4g} mm"
        )
    if not orientation_residual <= limits.max_orientation_residual:
        return (
            f"orientation residual {math.degrees(orientation_residual):.4g} degrees exceeds "
            f"{math.degrees(limits.max_orientation_residual):.4g} degrees"
        )
    return None


def expected_error_violation(
    position: float, orientation: float, limits: AcceptanceLimits
) -> str | None:
    """Why these expected errors [m], [rad] are too large, or None.

    NaN, of a robot that was not measured, is too large for any limit but infinity.
    """
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
            return (
                f"expected {what} is limited to {factor * limit:.4g} {unit}, but nobody knows it: "
                "the model was not learned from measured poses (annik fit)"
            )
        return (
            f"expected {what} {factor * expected:.4g} {unit} exceeds {factor * limit:.4g} {unit}"
        )
    return None


def largest_step_beyond(
    limit: float, joint_positions: FloatArray, reference: FloatArray
) -> tuple[int, float] | None:
    """Which joint is furthest from ``reference``, both ``(dof,)``, and by how much [rad or m].

    None if no joint is further than ``limit``; if that is infinite, nothing is compared.
    """
    if math.isinf(limit):
        return None
    steps = np.abs(joint_positions - reference)
    if (steps <= limit).all():
        return None
    joint = int(np.argmax(steps))
    return joint, float(steps[joint])


def joint_step_violation(
    joint_names: tuple[str, ...],
    joint_positions: FloatArray,
    previous: FloatArray,
    limits: AcceptanceLimits,
) -> str | None:
    """Why the step from ``previous`` to ``joint_positions``, both ``(dof,)``, is too large."""
    excess = largest_step_beyond(limits.max_joint_step, joint_positions, previous)
    if excess is None:
        return None
    joint, step = excess
    return (
        f"{joint_names[joint]} would step by {step:.6g}, more than "
        f"{limits.max_joint_step:.6g} from the previous command"
    )


class FirstCommandRule(Enum):
    """How the first command after the start is held to where the robot is.

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
        minimum=-math.inf,
        maximum=math.inf,
    )
    workspace_box_upper: tuple[float, ...] = setting(
        (math.inf,) * 3,
        "Greatest x, y, z of a target in the base frame; a target beyond is refused.",
        unit="m",
        minimum=-math.inf,
        maximum=math.inf,
    )
    max_target_age: float = setting(
        math.inf,
        "Largest difference of the stamp of a target from the present time, past or future; a "
        "target beyond it is refused, and so is a stamped target whose stamp is 0.",
        unit="s",
        greater_than=0.0,
        maximum=math.inf,
    )
    max_joint_velocity: float = setting(
        math.inf,
        "Largest change of any joint from the previous command, divided by the time since then; a "
        "command beyond it is refused.",
        unit="rad/s or m/s",
        greater_than=0.0,
        maximum=math.inf,
    )
    expected_rate: float = setting(
        0.0,
        "Expected rate of targets. A lower rate is a diagnostic warning; at a higher rate "
        "max_joint_velocity takes commands to be 1 / expected_rate apart. 0: unknown.",
        unit="Hz",
        minimum=0.0,
        maximum=100_000.0,
    )
    max_measured_step: float = setting(
        math.inf,
        "Largest distance of any joint of a command from its measured position, if joint_states "
        "are received; a command beyond it is refused.",
        unit="rad or m",
        greater_than=0.0,
        maximum=math.inf,
    )
    first_command: FirstCommandRule = setting(
        FirstCommandRule.NEAR_IF_MEASURED,
        "Whether max_first_step limits the first command after an activation. near_if_measured: "
        "if joint_states are received; near: always, and without joint_states it is refused; "
        "free: never.",
    )
    max_first_step: float = setting(
        0.2,
        "Largest distance of any joint of the first command from its measured position.",
        unit="rad or m",
        greater_than=0.0,
        maximum=math.inf,
    )

    def __post_init__(self) -> None:
        """Refuse limits that no target or command could satisfy."""
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


def box_violation(pose: Numbers, safety: CommandSafety) -> str | None:
    """Why the position of a pose ``(7,)`` is outside the workspace box, or None.

    A pose that is not finite has no violation here: that is another check's to say.
    """
    if not safety.has_workspace_box:
        return None
    bounds = zip(pose[:3], safety.workspace_box_lower, safety.workspace_box_upper, strict=True)
    for axis, (value, low, high) in enumerate(bounds):
        if math.isfinite(value) and not low <= value <= high:
            return (
                f"{POSE_FIELDS[axis]} is {value:.6g} m; the workspace box allows "
                f"{low:.6g} to {high:.6g} m"
            )
    return None


def age_violation(age: float | None, safety: CommandSafety) -> str | None:
    """Why a target of this age [s] is stale, or None. None for a target without a stamp."""
    limit = safety.max_target_age
    if age is None or abs(age) <= limit:
        return None
    if age < 0:
        return f"its stamp is {-age:.4g} s in the future, more than {limit:.4g} s: set the clocks"
    return f"it is {age:.4g} s old, more than {limit:.4g} s"


def velocity_violation(
    joint_names: tuple[str, ...],
    joint_positions: FloatArray,
    previous: FloatArray,
    interval: float,
    safety: CommandSafety,
) -> str | None:
    """Why the way from ``previous`` in ``interval`` [s] is too fast, or None; both ``(dof,)``."""
    if math.isinf(safety.max_joint_velocity):
        return None
    interval = max(interval, safety.shortest_interval)
    # As a product, so that no time at all is no division by zero.
    limit = safety.max_joint_velocity * interval
    excess = largest_step_beyond(limit, joint_positions, previous)
    if excess is None:
        return None
    joint, step = excess
    velocity = step / interval if interval > 0 else math.inf
    return (
        f"{joint_names[joint]} would move by {step:.6g} in {interval:.4g} s, "
        f"{velocity:.6g} per second; at most {safety.max_joint_velocity:.6g} is allowed"
    )


def measured_violation(
    joint_names: tuple[str, ...], joint_positions: FloatArray, measured: FloatArray, limit: float
) -> str | None:
    """Why joint positions ``(dof,)`` are further than ``limit`` [rad or m] from the measured."""
    excess = largest_step_beyond(limit, joint_positions, measured)
    if excess is None:
        return None
    joint, step = excess
    return (
        f"{joint_names[joint]} would go to {joint_positions[joint]:.6g}, but is measured at "
        f"{measured[joint]:.6g}: {step:.6g} away, more than {limit:.6g}"
    )
