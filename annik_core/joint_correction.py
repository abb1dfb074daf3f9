"""What a joint does of what it is told: corrections of the joint positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from annik_core.errors import InvalidRobotDefinition
from annik_core.pose import FloatArray
from annik_core.robot import checked_numbers

#: Numbers beyond it are slips, and what is computed of them overflows.
_LARGEST = 1e6
#: Least number that may be divided by.
_SMALLEST = 1e-9


class JointCorrection(Protocol):
    """Where joints really are, given the positions that were commanded."""

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """Actual joint positions, ``(n, dof)`` or ``(dof,)`` as given [rad or m]."""
        ...

    def slopes(self, joint_positions: FloatArray) -> FloatArray:
        """Their derivatives by the commanded ones, of the same shape: each joint for itself."""
        ...


@dataclass(frozen=True, eq=False)
class JointNetworks:
    """A small network per joint: its correction as a function of its own position.

    ``actual = q + sum over hidden units of output_weight * tanh(input_weight * x + bias)``, where
    ``x = (q - centre) / half_width``.

    Attributes:
        centre: ``(dof,)`` [rad or m].
        half_width: ``(dof,)`` [rad or m], not zero.
        input_weights: ``(dof, hidden)``.
        biases: ``(dof, hidden)``.
        output_weights: ``(dof, hidden)`` [rad or m].
    """

    centre: FloatArray
    half_width: FloatArray
    input_weights: FloatArray
    biases: FloatArray
    output_weights: FloatArray

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`JointCorrection`."""
        corrections: FloatArray = (self.output_weights * self.activations(joint_positions)).sum(-1)
        return joint_positions + corrections

    def slopes(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`JointCorrection`."""
        inner = self.output_weights * self.input_weights / self.half_width[:, np.newaxis]
        slopes: FloatArray = (inner * (1.0 - self.activations(joint_positions) ** 2)).sum(-1)
        return 1.0 + slopes

    @property
    def largest(self) -> FloatArray:
        """``(dof,)`` what no correction exceeds [rad or m]."""
        return np.asarray(np.abs(self.output_weights).sum(axis=1), dtype=np.float64)

    def activations(self, joint_positions: FloatArray) -> FloatArray:
        """The hidden units, ``(..., dof, hidden)``."""
        scaled = (joint_positions - self.centre) / self.half_width
        activations: FloatArray = np.tanh(
            scaled[..., np.newaxis] * self.input_weights + self.biases
        )
        return activations

    def as_plain_data(self) -> dict[str, Any]:
        """For a robot definition."""
        return {name: array.tolist() for name, array in vars(self).items()}

    @classmethod
    def from_plain_data(cls, data: Any, dof: int, source: str) -> JointNetworks:
        """The reverse of :meth:`as_plain_data`.

        Raises:
            InvalidRobotDefinition: naming what is missing or wrong.
        """
        what = "corrections.joint_networks"
        arrays = checked_arrays(data, tuple(cls.__dataclass_fields__), what, source)
        hidden = arrays["input_weights"].shape[-1:]
        for name in ("centre", "half_width"):
            check_shape(arrays[name], (dof,), f"{what}.{name}", source)
        for name in ("input_weights", "biases", "output_weights"):
            check_shape(arrays[name], (dof, *hidden), f"{what}.{name}", source)
        check_positive(arrays["half_width"], f"{what}.half_width", source)
        return cls(**arrays)


def checked_arrays(
    data: Any, names: tuple[str, ...], what: str, source: str
) -> dict[str, FloatArray]:
    """Finite arrays of a mapping that has just these names.

    Raises:
        InvalidRobotDefinition: naming what is missing, unknown, not finite or too large.
    """
    if not isinstance(data, Mapping):
        raise InvalidRobotDefinition(source, f"{what} is not a mapping")
    for name in sorted(set(names) ^ set(data), key=str):
        state = "missing" if name in names else "unknown"
        raise InvalidRobotDefinition(source, f"{what}.{name} is {state}")
    arrays = {name: checked_numbers(data[name], f"{what}.{name}", source) for name in names}
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise InvalidRobotDefinition(source, f"{what}.{name} is not finite")
        if np.abs(array).max(initial=0.0) > _LARGEST:
            raise InvalidRobotDefinition(source, f"{what}.{name} is beyond {_LARGEST:g}")
        array.flags.writeable = False
    return arrays


def check_shape(array: FloatArray, shape: tuple[int, ...], what: str, source: str) -> None:
    """Refuse an array of another shape.

    Raises:
        InvalidRobotDefinition: naming both.
    """
    if array.shape != shape:
        raise InvalidRobotDefinition(source, f"{what} has shape {array.shape}, not {shape}")


def check_positive(array: FloatArray, what: str, source: str) -> None:
    """Refuse zero and less, and what is as good as zero.

    Raises:
        InvalidRobotDefinition: naming the entry.
    """
    if not (array > 0.0).all():
        raise InvalidRobotDefinition(source, f"{what} is not positive")
    if not (array >= _SMALLEST).all():
        raise InvalidRobotDefinition(source, f"{what} is below {_SMALLEST:g}")
