"""What geometry and joints leave unexplained: a small correction of the end effector's pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.joint_correction import check_positive, check_shape, checked_arrays
from annik_core.pose import FloatArray


@dataclass(frozen=True, eq=False)
class PoseNetwork:
    """A small network from all joint positions to a motion of the end effector in its own frame.

    ``motion = output_weights @ tanh(input_weights @ x + biases)``, ``x`` being the joint positions
    scaled to their box. The motion is a twist, to be applied by the exponential map.

    Attributes:
        centre: ``(dof,)`` [rad or m].
        half_width: ``(dof,)`` [rad or m], not zero.
        input_weights: ``(hidden, dof)``.
        biases: ``(hidden,)``.
        output_weights: ``(6, hidden)``: three rows linear [m], three angular [rad].
    """

    centre: FloatArray
    half_width: FloatArray
    input_weights: FloatArray
    biases: FloatArray
    output_weights: FloatArray

    def motions(self, joint_positions: FloatArray) -> FloatArray:
        """Twists ``(n, 6)`` in the end effector's frame for joint positions ``(n, dof)``."""
        motions: FloatArray = self.activations(joint_positions) @ self.output_weights.T
        return motions

    @property
    def largest_shift(self) -> float:
        """What no motion shifts the end effector by more than [m]."""
        largest = np.abs(self.output_weights).sum(axis=1)
        linear, angular = np.linalg.norm(largest[:3]), np.linalg.norm(largest[3:])
        return float(linear * (1.0 + 0.5 * angular))

    def activations(self, joint_positions: FloatArray) -> FloatArray:
        """The hidden units, ``(n, hidden)``."""
        scaled = (joint_positions - self.centre) / self.half_width
        activations: FloatArray = np.tanh(scaled @ self.input_weights.T + self.biases)
        return activations

    def as_plain_data(self) -> dict[str, Any]:
        """For a robot definition."""
        return {name: array.tolist() for name, array in vars(self).items()}

    @classmethod
    def from_plain_data(cls, data: Any, dof: int, source: str) -> PoseNetwork:
        """The reverse of :meth:`as_plain_data`.

        Raises:
            InvalidRobotDefinition: naming what is missing or wrong.
        """
        what = "corrections.pose_network"
        arrays = checked_arrays(data, tuple(cls.__dataclass_fields__), what, source)
        hidden = arrays["biases"].shape[-1:]
        for name, shape in (
            ("centre", (dof,)),
            ("half_width", (dof,)),
            ("biases", hidden),
            ("input_weights", (*hidden, dof)),
            ("output_weights", (6, *hidden)),
        ):
            check_shape(arrays[name], shape, f"{what}.{name}", source)
        check_positive(arrays["half_width"], f"{what}.half_width", source)
        return cls(**arrays)
