"""Intervals of joint positions: the limits of the joints, and the joint box."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import le

import numpy as np
from numpy.typing import ArrayLike, NDArray

from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition


@dataclass(frozen=True, eq=False)
class JointLimits:
    """One closed interval per joint, bounds ``(dof,)`` [rad or m]; equal bounds lock a joint."""

    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray

    @classmethod
    def from_bounds(
        cls, joint_names: Sequence[str], lower: ArrayLike, upper: ArrayLike
    ) -> "JointLimits":
        """Limits from two arrays ``(dof,)``.

        Raises:
            InvalidRobotDefinition: if a bound is not finite or an interval is empty; names it.
        """
        low = np.array(lower, dtype=np.float64)
        high = np.array(upper, dtype=np.float64)
        names = tuple(joint_names)
        if low.shape != (len(names),) or high.shape != (len(names),):
            raise InvalidRobotDefinition(
                "joint limits",
                f"{len(names)} joints but {low.size} lower and {high.size} upper bounds",
            )
        for name, low_bound, high_bound in zip(names, low, high, strict=True):
            if not (np.isfinite(low_bound) and np.isfinite(high_bound)):
                raise InvalidRobotDefinition(
                    f"joint {name}", f"limits [{low_bound}, {high_bound}] are not finite"
                )
            if low_bound > high_bound:
                raise InvalidRobotDefinition(
                    f"joint {name}", f"lower limit {low_bound} is above upper limit {high_bound}"
                )
        low.flags.writeable = False
        high.flags.writeable = False
        return cls(names, low, high)

    @property
    def centre(self) -> FloatArray:
        """``(dof,)``, the middle of each interval."""
        return 0.5 * (self.lower + self.upper)

    def sample(self, count: int, rng: "np.random.Generator") -> FloatArray:
        """Random joint positions ``(count, dof)``, independent and uniform in every interval."""
        return rng.uniform(self.lower, self.upper, (count, len(self.lower)))

    def contains(self, joint_positions: FloatArray) -> bool:
        """Whether ``(dof,)`` or every row of ``(n, dof)`` is inside. NaN is not."""
        if joint_positions.ndim == 1:
            # Plain floats: for so few NumPy's comparisons take several times as long.
            lower, upper = self._bounds
            values = joint_positions.tolist()
            return all(map(le, lower, values)) and all(map(le, values, upper))
        return bool(((joint_positions >= self.lower) & (joint_positions <= self.upper)).all())

    @cached_property
    def free(self) -> NDArray[np.int64]:
        """Indices ``(free,)`` of the joints that are not locked."""
        return np.flatnonzero(self.upper > self.lower)

    @cached_property
    def _bounds(self) -> tuple[list[float], list[float]]:
        return self.lower.tolist(), self.upper.tolist()

    def violation(self, joint_positions: FloatArray) -> str | None:
        """The first joint of ``(dof,)`` that is outside, with its interval, or None."""
        if self.contains(joint_positions):
            return None
        outside = ~((joint_positions >= self.lower) & (joint_positions <= self.upper))
        joint = int(np.flatnonzero(outside)[0])
        return (
            f"{self.joint_names[joint]} would be {joint_positions[joint]:.6g}, outside "
            f"[{self.lower[joint]:.6g}, {self.upper[joint]:.6g}]"
        )
