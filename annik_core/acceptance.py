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

    Raises:
        InvalidAcceptanceLimit: if a limit is NaN, zero or negative.
    """

    max_position_residual: float = 1e-3
    max_orientation_residual: float = 5e-3
    max_joint_step: float = math.inf

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


def joint_step_violation(
    joint_names: tuple[str, ...],
    joint_positions: FloatArray,
    previous: FloatArray,
    limits: AcceptanceLimits,
) -> str | None:
    """Why the step from ``previous`` to ``joint_positions``, both ``(dof,)``, is too large."""
    if math.isinf(limits.max_joint_step):
        return None
    steps = np.abs(joint_positions - previous)
    if (steps <= limits.max_joint_step).all():
        return None
    joint = int(np.argmax(steps))
    return (
        f"{joint_names[joint]} would step by {steps[joint]:.6g}, more than "
        f"{limits.max_joint_step:.6g} from the previous command"
    )
