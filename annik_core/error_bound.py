"""How far a learned model of a robot may be from the robot, pose by pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.errors import InvalidRobotDefinition
from annik_core.joint_correction import check_positive, check_shape, checked_arrays
from annik_core.pose import FloatArray

#: Greatest logarithm of a bound that makes sense.
_LARGEST_EXPONENT = 100.0


@dataclass(frozen=True, eq=False)
class ErrorBound:
    """The error that 95 of 100 poses stay below, as a function of the joint positions.

    Its logarithm is quadratic in ``x``, the joint positions scaled to their box: ``coefficients``
    times (1, x_i, x_i x_j for i <= j).

    Attributes:
        centre: ``(dof,)`` [rad or m].
        half_width: ``(dof,)`` [rad or m], not zero.
        coefficients: ``(2, 1 + dof + dof (dof + 1) / 2)``: of the distance [m] and of the angle
            [rad].
    """

    centre: FloatArray
    half_width: FloatArray
    coefficients: FloatArray

    def at(self, joint_positions: FloatArray) -> tuple[float, float]:
        """Bounds of the distance [m] and the angle [rad] at joint positions ``(dof,)``."""
        position, orientation = (
            self.coefficients @ quadratic_features(self.scaled(joint_positions)[np.newaxis])[0]
        ).tolist()
        return math.exp(position), math.exp(orientation)

    def scaled(self, joint_positions: FloatArray) -> FloatArray:
        """The joint positions ``(..., dof)``, the box being [-1, 1]; not beyond it.

        Outside the box nothing is known; a parabola would say anything there.
        """
        scaled = (joint_positions - self.centre) / self.half_width
        clipped: FloatArray = np.minimum(np.maximum(scaled, -1.0), 1.0)
        return clipped

    def as_plain_data(self) -> dict[str, Any]:
        """For a robot definition."""
        return {name: array.tolist() for name, array in vars(self).items()}

    @classmethod
    def from_plain_data(cls, data: Any, dof: int, source: str) -> ErrorBound:
        """The reverse of :meth:`as_plain_data`.

        Raises:
            InvalidRobotDefinition: naming what is missing or wrong.
        """
        what = "corrections.error_bound"
        arrays = checked_arrays(data, tuple(cls.__dataclass_fields__), what, source)
        for name, shape in (
            ("centre", (dof,)),
            ("half_width", (dof,)),
            ("coefficients", (2, 1 + dof + dof * (dof + 1) // 2)),
        ):
            check_shape(arrays[name], shape, f"{what}.{name}", source)
        check_positive(arrays["half_width"], f"{what}.half_width", source)
        # Beyond it the exponential is no number.
        if np.abs(arrays["coefficients"]).sum(axis=1).max() > _LARGEST_EXPONENT:
            raise InvalidRobotDefinition(source, f"{what}.coefficients are too large for bounds")
        return cls(**arrays)


def quadratic_features(scaled: FloatArray) -> FloatArray:
    """``(n, 1 + dof + dof (dof + 1) / 2)``: 1, x_i and x_i x_j of rows ``(n, dof)``."""
    first, second = np.triu_indices(scaled.shape[1])
    return np.concatenate(
        [np.ones((len(scaled), 1)), scaled, scaled[:, first] * scaled[:, second]], axis=1
    )
