"""A robot that is where it was last told to be: the part of the fake robot that needs no ROS."""

from __future__ import annotations

from annik_core.errors import (
    AnnikError,
    MalformedJointState,
    MissingJoint,
    NonFiniteValue,
)
from annik_core.pose import FloatArray
from annik_core.robot import Robot
from annik_core.tracking_error import achieved_pose


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
    """Follows every valid command at once and exactly.

    Attributes:
        robot: the robot that it stands in for.
        joint_positions: ``(dof,)`` where it is [rad or m]; the middle of the working joint box
            until the first command.
    """

    def __init__(self, robot: Robot) -> None:
        """Stand in for ``robot``."""
        self.robot = robot
        self.joint_positions: FloatArray = robot.joint_box.centre

    def move_to(self, joint_positions: FloatArray) -> FloatArray:
        """Take up joint positions ``(dof,)`` [rad or m].

        Returns:
            The pose ``(7,)`` of the end effector there, in the base frame.

        Raises:
            CommandOutsideLimits: if a joint would leave its limits, or a position is NaN; the
                robot stays where it is.
        """
        violation = self.robot.joint_limits.violation(joint_positions)
        if violation is not None:
            raise CommandOutsideLimits(violation)
        self.joint_positions = joint_positions
        return achieved_pose(self.robot, joint_positions)
