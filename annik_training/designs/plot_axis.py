"""A joint as an axis of a plot: positions in degrees, mm or m, bounds, label."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits


@dataclass(frozen=True, eq=False)
class JointAxis:
    """A joint that is not locked.

    Attributes:
        name: name of the joint.
        unit: ``deg``, ``mm`` or ``m``; unit of the numbers below.
        positions: ``(n,)`` of the examples.
        lower: lower bound of the joint box.
        upper: upper bound.
    """

    name: str
    unit: str
    positions: FloatArray
    lower: float
    upper: float

    @property
    def shown(self) -> tuple[float, float]:
        """Limits of the axis: the interval and a margin for the markers."""
        margin = 0.09 * (self.upper - self.lower)
        return self.lower - margin, self.upper + margin

    @property
    def ticks(self) -> list[float]:
        """Minimum, median and maximum, the levels of the designs."""
        return [self.lower, 0.5 * (self.lower + self.upper), self.upper]

    @property
    def numbers(self) -> list[str]:
        """The ticks as text."""
        return [f"{tick:.3g}" for tick in self.ticks]

    def label(self, letters: int) -> str:
        """Name and unit, broken at underscores into lines of at most so many letters."""
        lines = [""]
        for part in self.name.replace("_", "_\n").split("\n"):
            if lines[-1] and len(lines[-1]) + len(part) > letters:
                lines.append("")
            lines[-1] += part
        return "\n".join([*lines, f"[{self.unit}]"])


def joint_axes(
    joint_positions: FloatArray, box: JointLimits, joint_types: Sequence[str]
) -> list[JointAxis]:
    """Axes of the joints that are not locked, in order.

    Args:
        joint_positions: ``(n, dof)`` [rad or m].
        box: the joint box.
        joint_types: ``prismatic`` (drawn in mm or m) or another (in degrees) for each joint.
    """
    axes = []
    for joint in box.free:
        lower, upper = float(box.lower[joint]), float(box.upper[joint])
        unit, scale = _unit(joint_types[joint], max(abs(lower), abs(upper)))
        positions = scale * joint_positions[:, joint]
        axes.append(
            JointAxis(box.joint_names[joint], unit, positions, scale * lower, scale * upper)
        )
    return axes


def _unit(joint_type: str, largest: float) -> tuple[str, float]:
    """Unit for positions of at most ``largest`` [rad or m], and the factor to it."""
    if joint_type != "prismatic":
        return "deg", 180.0 / np.pi
    return ("mm", 1000.0) if largest < 1.0 else ("m", 1.0)
