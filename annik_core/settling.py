"""Whether a robot stands still where it was told to be."""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray


class Settling:
    """Watches joint positions, until they have been at a target and still for a while."""

    def __init__(
        self, target: FloatArray, tolerance: float, stillness: float, time: float
    ) -> None:
        """Begin to watch.

        Args:
            target: ``(dof,)`` [rad or m].
            tolerance: how far from the target each joint may be [rad or m].
            stillness: how far it may move while it is said to stand still [rad or m].
            time: how long it has to [s].
        """
        self._target = target
        self._tolerance = tolerance
        self._stillness = stillness
        self._time = time
        self._since: float | None = None
        self._reference = target
        self.is_settled = False

    def update(self, time: float, joint_positions: FloatArray) -> bool:
        """Take joint positions ``(dof,)`` measured at ``time`` [s]; whether it has settled."""
        if not self.is_near_target(joint_positions):
            self._since = None
        elif self._since is None or _distance(joint_positions, self._reference) > self._stillness:
            self._since, self._reference = time, joint_positions
        self.is_settled = self._since is not None and time - self._since >= self._time
        return self.is_settled

    def is_near_target(self, joint_positions: FloatArray) -> bool:
        """Whether every joint is within the tolerance of the target."""
        return _distance(joint_positions, self._target) <= self._tolerance

    def describe(self, joint_names: tuple[str, ...], joint_positions: FloatArray) -> str:
        """Which joint is furthest from the target, for a robot that does not settle."""
        joint = int(np.abs(joint_positions - self._target).argmax())
        distance = abs(float(joint_positions[joint] - self._target[joint]))
        what = "is" if distance > self._tolerance else "moves still; it is"
        return (
            f"{joint_names[joint]} {what} {distance:.4g} from its command; the settle_tolerance "
            f"is {self._tolerance:.4g}"
        )


def _distance(one: FloatArray, other: FloatArray) -> float:
    return float(np.abs(one - other).max(initial=0.0))
