"""The error of a gear that comes again with every turn of its joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.joint_correction import JointCorrection
from annik_core.pose import FloatArray


@dataclass(frozen=True, eq=False)
class PeriodicTransmissionError(JointCorrection):
    """``actual = q + amplitude * sin(q + phase)``, each joint for itself.

    Attributes:
        amplitude: ``(dof,)`` [rad]; less than 1, or a joint would turn backwards.
        phase: ``(dof,)`` [rad].
    """

    amplitude: FloatArray
    phase: FloatArray

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.joint_correction.JointCorrection`."""
        actual: FloatArray = joint_positions + self.amplitude * np.sin(
            joint_positions + self.phase
        )
        return actual

    def slopes(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.joint_correction.JointCorrection`."""
        slopes: FloatArray = 1.0 + self.amplitude * np.cos(joint_positions + self.phase)
        return slopes
