"""What can be learned: for joint positions, what a network sees and what it should say."""

from __future__ import annotations

from typing import Protocol

from annik_core.joint_limits import JointLimits
from annik_core.pose import FloatArray


class System(Protocol):
    """Inputs and targets of a network as functions of the joint positions. Batched.

    For inverse kinematics the inputs are the features of the pose and the targets are the joint
    positions themselves; for a function to be learned forwards, the inputs are the joint
    positions. Either way a design of experiments chooses joint positions, and the derivatives of
    inputs and targets in them are all that Sobolev training needs: the Jacobian of the forward
    kinematics, and no inverse of it.
    """

    @property
    def name(self) -> str:
        """Short name."""
        ...

    @property
    def joint_box(self) -> JointLimits:
        """Where the examples are drawn from."""
        ...

    @property
    def target_box(self) -> tuple[FloatArray, FloatArray]:
        """Least and greatest targets ``(k,)``; the outputs of a network are scaled to them."""
        ...

    @property
    def error_unit(self) -> str:
        """Unit of :meth:`errors`."""
        ...

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """What the network sees ``(n, m)`` at joint positions ``(n, dof)``."""
        ...

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """What it should say ``(n, k)``."""
        ...

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the inputs ``(n, m, dof)``."""
        ...

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the targets ``(n, k, dof)``."""
        ...

    def errors(self, joint_positions: FloatArray, answers: FloatArray) -> FloatArray:
        """How wrong answers ``(n, k)`` are at joint positions ``(n, dof)``: ``(n,)``, 0 if right.

        For inverse kinematics, the distance between where the answers lead and where the joint
        positions do; for a function, the root of the mean square error over its outputs.
        """
        ...
