"""How far an answer is polished, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray


class InvalidRefinementOption(AnnikError):
    """An option of the refinement is out of range."""

    def __init__(self, option: str, value: float, allowed: str) -> None:
        self.option = option
        self.value = value
        super().__init__(f"{option} is {value}; allowed: {allowed}")


@dataclass(frozen=True)
class RefinementOptions:
    """How far to polish.

    Attributes:
        max_newton_steps: most steps for one target, which bounds the time.
        tolerance: done when the distance [m] and the angle [rad] to the target are at most this.

    Raises:
        InvalidRefinementOption: naming the option and what is allowed.
    """

    max_newton_steps: int = 10
    tolerance: float = 5e-7

    def __post_init__(self) -> None:
        """Refuse options that make no sense."""
        if not 0 <= self.max_newton_steps <= 1000:
            raise InvalidRefinementOption(
                "max_newton_steps", self.max_newton_steps, "0 to 1000 steps"
            )
        if not 1e-12 <= self.tolerance <= 1.0:
            raise InvalidRefinementOption("tolerance", self.tolerance, "1e-12 to 1 m and rad")


class Refined(NamedTuple):
    """Where a refinement ended.

    Attributes:
        joint_positions: ``(dof,)`` [rad or m], inside the box.
        position_residual: distance to the target at exactly these [m].
        orientation_residual: angle to the target's orientation [rad].
        newton_steps: steps taken, all searches together.
        converged: whether both residuals are within the tolerance.
    """

    joint_positions: FloatArray
    position_residual: float
    orientation_residual: float
    newton_steps: int
    converged: bool
