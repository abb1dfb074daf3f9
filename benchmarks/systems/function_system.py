"""Functions of the joint positions as something to learn forwards, joint positions in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits


@dataclass(frozen=True)
class FunctionSystem:
    """See :class:`annik_training.fitting.problem.System`. Errors are rms over the outputs.

    Attributes:
        name: short name.
        joint_box: the domain.
        target_box: least and greatest values of the outputs on it.
        function: joint positions ``(n, dof)`` to outputs ``(n, k)``.
        derivative: joint positions ``(n, dof)`` to derivatives ``(n, k, dof)``.
        error_unit: unit of the outputs, if they have one.
    """

    name: str
    joint_box: JointLimits
    target_box: tuple[FloatArray, FloatArray]
    function: Callable[[FloatArray], FloatArray]
    derivative: Callable[[FloatArray], FloatArray]
    error_unit: str = ""

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """The joint positions themselves."""
        return joint_positions

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """The function."""
        return self.function(joint_positions)

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """The identity."""
        examples, dof = joint_positions.shape
        return np.tile(np.eye(dof), (examples, 1, 1))

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """The derivative."""
        return self.derivative(joint_positions)

    def errors(self, joint_positions: FloatArray, predicted: FloatArray) -> FloatArray:
        """Root of the mean square error over the outputs, at each example."""
        squared = (predicted - self.function(joint_positions)) ** 2
        errors: FloatArray = np.sqrt(np.mean(squared, axis=1))
        return errors


def _joints(count: int, lower: float, upper: float) -> JointLimits:
    return JointLimits(
        tuple(f"q{number}" for number in range(1, count + 1)),
        np.full(count, lower),
        np.full(count, upper),
    )


def paper_functions() -> FunctionSystem:
    """F = (f1, ..., f6) of section 2, eq. (7)-(12), for joint positions from 0 to 90 degrees.

    In radians: q / 9 of eq. (10)-(12), in degrees, is 10 q / q_max.
    """
    greatest = 0.5 * np.pi

    def function(q: FloatArray) -> FloatArray:
        return 10.0 * np.column_stack(
            [
                np.sin(q[:, 0]),
                1.0 - np.cos(q[:, 1]),
                (q[:, 2] / greatest) ** 2,
                q[:, 3:] / greatest,
            ]
        )

    def derivative(q: FloatArray) -> FloatArray:
        # Each function depends on its own joint only.
        derivatives = np.column_stack(
            [
                np.cos(q[:, 0]),
                np.sin(q[:, 1]),
                2.0 * q[:, 2] / greatest**2,
                np.full((len(q), 3), 1.0 / greatest),
            ]
        )
        return 10.0 * derivatives[:, :, np.newaxis] * np.eye(6)

    return FunctionSystem(
        "F", _joints(6, 0.0, greatest), (np.zeros(6), np.full(6, 10.0)), function, derivative
    )


def interaction() -> FunctionSystem:
    """(q1 - q2)(q4 - q6) / 4 on [-1, 1]^6: zero on all examples of the paper's design."""

    def function(q: FloatArray) -> FloatArray:
        return ((q[:, 0] - q[:, 1]) * (q[:, 3] - q[:, 5]) / 4.0)[:, np.newaxis]

    def derivative(q: FloatArray) -> FloatArray:
        derivatives = np.zeros((len(q), 1, 6))
        derivatives[:, 0, 0] = (q[:, 3] - q[:, 5]) / 4.0
        derivatives[:, 0, 1] = -derivatives[:, 0, 0]
        derivatives[:, 0, 3] = (q[:, 0] - q[:, 1]) / 4.0
        derivatives[:, 0, 5] = -derivatives[:, 0, 3]
        return derivatives

    return FunctionSystem(
        "interaction", _joints(6, -1.0, 1.0), (-np.ones(1), np.ones(1)), function, derivative
    )
