"""Exceptions of robot definitions."""

from collections.abc import Sequence

from annik_core.errors import AnnikError


class RobotError(AnnikError):
    """A robot definition can't be used."""


class UnknownRobot(RobotError):
    """No packaged robot has this name, and no file has this path."""

    def __init__(self, name: str, known: Sequence[str]) -> None:
        self.name = name
        self.known = tuple(known)
        super().__init__(
            f"no robot {name!r} and no such file: give one of the packaged robots "
            f"({', '.join(self.known)}) or the path of a robot definition (YAML) or a URDF"
        )


class InvalidRobotDefinition(RobotError):
    """A robot definition is incomplete or contradicts itself."""

    def __init__(self, source: str, problem: str) -> None:
        self.source = source
        self.problem = problem
        super().__init__(f"robot definition {source}: {problem}")
