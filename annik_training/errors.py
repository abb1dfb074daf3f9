"""Exceptions that several rooms of the training raise."""

from annik_core.errors import AnnikError


class UnsupportedRobot(AnnikError):
    """A robot lacks what a design of experiments or a calibration needs."""

    def __init__(self, purpose: str, robot: str, reason: str) -> None:
        self.purpose = purpose  #: what needs it
        self.robot = robot
        self.reason = reason
        super().__init__(f"{purpose} can't be used with {robot}: {reason}")
