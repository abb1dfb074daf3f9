"""A simulated robot that follows commands at once. Needs no ROS."""

import numpy as np

from annik_core.errors import AnnikError, MalformedJointState, MissingJoint, NonFiniteValue
from annik_core.pose import FloatArray
from annik_core.reachable_paths import start_positions
from annik_core.robots.robot import Robot
from annik_core.simulation.imperfections import Imperfections, imperfect_kinematics


class CommandOutsideLimits(AnnikError):
    """A command is beyond the limits of a joint."""

    def __init__(self, violation: str) -> None:
        self.violation = violation
        super().__init__(violation)


#: The counted reason of each refusal of a command.
_REFUSAL_REASONS: dict[type[AnnikError], str] = {
    MalformedJointState: "malformed",
    MissingJoint: "missing joint",
    NonFiniteValue: "not finite",
    CommandOutsideLimits: "joint limit",
}


def refusal_reason(error: AnnikError) -> str:
    """The counted reason of a refusal."""
    return _REFUSAL_REASONS.get(type(error), "other")


class FakeRobot:
    """Follows every valid command at once; exactly, or as an imperfect arm.

    Attributes:
        joint_positions: ``(dof,)`` of its drives [rad or m]; before the first command
            :func:`annik_core.reachable_paths.start_positions`.
    """

    def __init__(self, robot: Robot, imperfections: Imperfections | None = None) -> None:
        """Simulate ``robot``, with imperfections if given.

        Raises:
            InvalidImperfections: if they do not fit the robot.
        """
        self.robot = robot
        self.joint_positions: FloatArray = start_positions(robot)
        self._imperfections = imperfections
        self._kinematics = robot.forward_kinematics
        self._half_backlash: FloatArray = np.zeros(robot.dof)
        if imperfections is not None:
            self._kinematics = imperfect_kinematics(robot, imperfections)
            self._half_backlash = 0.5 * imperfections.backlash
        # The positions of the joints, behind the backlash.
        self._driven_positions: FloatArray = self.joint_positions

    @property
    def pose(self) -> FloatArray:
        """The true pose ``(7,)`` of the end effector in the base frame."""
        pose: FloatArray = self._kinematics.poses(self._driven_positions[np.newaxis])[0]
        return pose

    def move_to(self, joint_positions: FloatArray) -> FloatArray:
        """Move the drives to ``(dof,)`` joint positions [rad or m]; return the true pose ``(7,)``.

        Raises:
            CommandOutsideLimits: if a joint would leave its limits, or a position is NaN; the
                robot does not move.
        """
        violation = self.robot.joint_limits.violation(joint_positions)
        if violation is not None:
            raise CommandOutsideLimits(violation)
        self.joint_positions = joint_positions
        # A joint moves once its drive has crossed the play, and lags behind by half of it.
        self._driven_positions = np.clip(
            self.robot.unwrapped(self._driven_positions, joint_positions),
            joint_positions - self._half_backlash,
            joint_positions + self._half_backlash,
        )
        return self.pose

    def measure(self, rng: np.random.Generator) -> FloatArray | None:
        """The pose ``(7,)`` as a tracker measures it; None if the measurement is lost."""
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
    """A pose ``(7,)`` shifted by ``(3,)`` [m] and turned by a rotation vector ``(3,)`` [rad]."""
    from scipy.spatial.transform import Rotation

    orientation = Rotation.from_rotvec(rotation) * Rotation.from_quat(pose[3:])
    return np.concatenate([pose[:3] + position, orientation.as_quat(canonical=True)])
