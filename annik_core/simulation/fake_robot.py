"""A robot that goes where it is told to, or nearly: the fake robot without its ROS."""

from __future__ import annotations

import numpy as np

from annik_core.errors import AnnikError, MalformedJointState, MissingJoint, NonFiniteValue
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_core.simulation.imperfections import Imperfections, imperfect_kinematics


class CommandOutsideLimits(AnnikError):
    """A command would take a joint beyond its limits."""

    def __init__(self, violation: str) -> None:
        self.violation = violation
        super().__init__(violation)


#: What each refusal of a command is counted as.
_REFUSAL_REASONS: dict[type[AnnikError], str] = {
    MalformedJointState: "malformed",
    MissingJoint: "missing joint",
    NonFiniteValue: "not finite",
    CommandOutsideLimits: "joint limit",
}


def refusal_reason(error: AnnikError) -> str:
    """The short name that a refusal is counted under."""
    return _REFUSAL_REASONS.get(type(error), "other")


class FakeRobot:
    """Follows every valid command at once; exactly, or as an imperfect arm does.

    Attributes:
        robot: the robot that it stands in for, as described: without its imperfections.
        joint_positions: ``(dof,)`` where its drives are [rad or m]; the middle of the working
            joint box until the first command.
    """

    def __init__(self, robot: Robot, imperfections: Imperfections | None = None) -> None:
        """Stand in for ``robot``, or for a real one that differs from it.

        Raises:
            InvalidImperfections: if they can't be those of this robot.
            UnsupportedRobotForImperfections: if it is not an arm.
        """
        self.robot = robot
        self.joint_positions: FloatArray = robot.joint_box.centre
        self._imperfections = imperfections
        self._kinematics = robot.forward_kinematics
        self._half_backlash: FloatArray = np.zeros(robot.dof)
        if imperfections is not None:
            self._kinematics = imperfect_kinematics(robot, imperfections)
            self._half_backlash = 0.5 * imperfections.backlash
        # Where the drives' motion arrives, behind the backlash.
        self._driven_positions: FloatArray = self.joint_positions

    @property
    def pose(self) -> FloatArray:
        """The pose ``(7,)`` in which the end effector really is, in the base frame."""
        pose: FloatArray = self._kinematics.poses(self._driven_positions[np.newaxis])[0]
        return pose

    def move_to(self, joint_positions: FloatArray) -> FloatArray:
        """Take up joint positions ``(dof,)`` [rad or m].

        Returns:
            The pose ``(7,)`` in which the end effector really is then, in the base frame.

        Raises:
            CommandOutsideLimits: if a joint would leave its limits, or a position is NaN; the
                robot stays where it is.
        """
        violation = self.robot.joint_limits.violation(joint_positions)
        if violation is not None:
            raise CommandOutsideLimits(violation)
        self.joint_positions = joint_positions
        # A joint moves once its drive has crossed the play, and then half of it behind.
        self._driven_positions = np.clip(
            self._driven_positions,
            joint_positions - self._half_backlash,
            joint_positions + self._half_backlash,
        )
        return self.pose

    def measure(self, rng: np.random.Generator) -> FloatArray | None:
        """Measure the end effector, as a tracker does.

        Args:
            rng: what draws the noise.

        Returns:
            The measured pose ``(7,)`` in the base frame, or None if the measurement is lost.
        """
        if self._imperfections is None:
            return self.pose
        if rng.random() < self._imperfections.dropped:
            return None
        return _noisy(
            self.pose,
            self._imperfections.position_noise * rng.standard_normal(3),
            self._imperfections.orientation_noise * rng.standard_normal(3),
        )


def _noisy(pose: FloatArray, position: FloatArray, rotation: FloatArray) -> FloatArray:
    """A pose ``(7,)`` moved by ``(3,)`` [m] and turned by the rotation vector ``(3,)`` [rad]."""
    from scipy.spatial.transform import Rotation

    orientation = Rotation.from_rotvec(rotation) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + position, orientation.as_quat(canonical=True)])
