"""An elbow arm of three joints, in closed form: a small robot that is coupled and not linear.

Base, shoulder and elbow, as in the textbooks: the first joint turns about the vertical, the other
two are parallel and move the arm in a vertical plane. Targets are positions of its tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits


@dataclass(frozen=True)
class ElbowArm:
    """See :class:`annik_training.fitting.problem.System`. Errors are distances of the tip.

    The joint box keeps the elbow on one side, and the tip off the axis of the base, so that the
    inverse is a function.

    Attributes:
        height: of the shoulder [m].
        upper_arm: length [m].
        forearm: length [m].
    """

    height: float = 0.2
    upper_arm: float = 0.4
    forearm: float = 0.3
    name: str = "elbow_arm"
    error_unit: str = "mm"

    @property
    def joint_box(self) -> JointLimits:
        """Base -75 to 75 degrees, shoulder 15 to 75 up from horizontal, elbow -120 to -30."""
        return JointLimits(
            ("base", "shoulder", "elbow"),
            np.radians([-75.0, 15.0, -120.0]),
            np.radians([75.0, 75.0, -30.0]),
        )

    @property
    def target_box(self) -> tuple[FloatArray, FloatArray]:
        """The joint box."""
        box = self.joint_box
        return box.lower, box.upper

    def inputs(self, joint_positions: FloatArray) -> FloatArray:
        """Position of the tip ``(n, 3)`` x, y, z [m]."""
        base = joint_positions[:, 0]
        reach, rise = self._in_plane(joint_positions)
        return np.column_stack([np.cos(base) * reach, np.sin(base) * reach, self.height + rise])

    def targets(self, joint_positions: FloatArray) -> FloatArray:
        """The joint positions themselves."""
        return joint_positions

    def input_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """The Jacobian ``(n, 3, 3)`` of the tip's position."""
        base = joint_positions[:, 0]
        reach, rise = self._in_plane(joint_positions)
        forearm_angle = joint_positions[:, 1] + joint_positions[:, 2]
        # Shoulder and elbow turn what is beyond them by a right angle in the plane.
        reach_rates = np.column_stack([-rise, -self.forearm * np.sin(forearm_angle)])
        rise_rates = np.column_stack([reach, self.forearm * np.cos(forearm_angle)])
        jacobians = np.zeros((len(base), 3, 3))
        jacobians[:, 0, 0] = -np.sin(base) * reach
        jacobians[:, 1, 0] = np.cos(base) * reach
        jacobians[:, 0, 1:] = np.cos(base)[:, np.newaxis] * reach_rates
        jacobians[:, 1, 1:] = np.sin(base)[:, np.newaxis] * reach_rates
        jacobians[:, 2, 1:] = rise_rates
        return jacobians

    def target_jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """The identity: network(forward(q)) = q."""
        return np.tile(np.eye(3), (len(joint_positions), 1, 1))

    def errors(self, joint_positions: FloatArray, predicted: FloatArray) -> FloatArray:
        """Distances [mm] between the tip at predicted and at true joint positions."""
        offset = self.inputs(predicted) - self.inputs(joint_positions)
        distances: FloatArray = 1e3 * np.linalg.norm(offset, axis=1)
        return distances

    def _in_plane(self, joint_positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Horizontal reach and rise above the shoulder [m]."""
        shoulder = joint_positions[:, 1]
        forearm_angle = shoulder + joint_positions[:, 2]
        reach = self.upper_arm * np.cos(shoulder) + self.forearm * np.cos(forearm_angle)
        rise = self.upper_arm * np.sin(shoulder) + self.forearm * np.sin(forearm_angle)
        return reach, rise
