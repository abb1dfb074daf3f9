"""Exceptions of designs of experiments."""

from __future__ import annotations

from collections.abc import Sequence

from annik_core.errors import AnnikError


class DesignError(AnnikError):
    """A design of experiments can't be made as asked."""


class UnknownDesign(DesignError):
    """No design of experiments has this name."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name = name
        self.known = tuple(known)
        super().__init__(f"no design {name!r}: choose one of {', '.join(self.known)}")


class InvalidDesignSize(DesignError):
    """The requested size of a design is out of range."""

    def __init__(self, design: str, option: str, value: int, minimum: int, maximum: int) -> None:
        self.design = design
        self.option = option
        self.value = value
        self.allowed = (minimum, maximum)
        super().__init__(
            f"design {design}: {option} is {value}; it must be from {minimum} to {maximum}"
        )


class UnsupportedRobotForDesign(DesignError):
    """A design needs something that this robot does not offer."""

    def __init__(self, design: str, robot: str, reason: str) -> None:
        self.design = design
        self.robot = robot
        self.reason = reason
        super().__init__(f"design {design} can't be used with robot {robot}: {reason}")
