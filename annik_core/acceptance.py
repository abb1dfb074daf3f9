"""The checks on an answer, one function each: pure, and told what they need."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray


class InvalidAcceptanceLimit(AnnikError):
    """An acceptance limit is not a positive number."""

    def __init__(self, name: str, value: float) -> None:
        self.name = name
        self.value = value
        super().__init__(f"{name} is {value}; it must be greater than 0 (inf: no limit)")


@dataclass(frozen=True)
class AcceptanceLimits:
    """What an answer must satisfy to be commanded.

    Attributes:
        max_position_residual: largest distance from the target [m].
        max_orientation_residual: largest angle from the target's orientation [rad].
        max_joint_step: largest change of any joint from the previous command [rad or m].
        max_expected_error: largest distance between where the model says that the robot goes and
            where it may really go [m]; see :class:`annik_core.error_bound.ErrorBound`.
        max_expected_orientation_error: likewise the angle [rad].

    Raises:
        InvalidAcceptanceLimit: if a limit is NaN, zero or negative.
    """

    max_position_residual: float = 1e-3
    max_orientation_residual: float = 5e-3
    max_joint_step: float = math.inf
    max_expected_error: float = math.inf
    max_expected_orientation_error: float = math.inf

    def __post_init__(self) -> None:
        """Refuse limits that no answer, or any answer, could satisfy."""
        for name, value in vars(self).items():
            if not value > 0:
                raise InvalidAcceptanceLimit(name, value)


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
