"""Options and result of a refinement."""

from dataclasses import dataclass
from typing import NamedTuple

from annik_core.pose import FloatArray
from annik_core.settings import CheckedSettings, setting


@dataclass(frozen=True)
class RefinementOptions(CheckedSettings):
    """When a refinement ends."""

    max_newton_steps: int = setting(
        10,
        "Most iterations of the refinement of one target, which bounds its time; a solution that "
        "has not converged by then is refused.",
        within=(0, 1000),
    )
    tolerance: float = setting(
        5e-7,
        "The refinement has converged when distance and angle to the target are at most this.",
        unit="m and rad",
        within=(1e-12, 1.0),
    )


class RefinementResult(NamedTuple):
    """Where a refinement ended.

    Attributes:
        joint_positions: ``(dof,)`` [rad or m], inside the box.
        position_residual: distance to the target at exactly these [m].
        orientation_residual: angle to the target's orientation [rad].
        converged: whether both residuals are within the tolerance.
    """

    joint_positions: FloatArray
    position_residual: float
    orientation_residual: float
    newton_steps: int
    converged: bool
