"""Exceptions of bags."""

from pathlib import Path

from annik_core.errors import AnnikError


class BagNotReadable(AnnikError):
    """The bag is damaged beyond use, or not a bag."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"bag {path}: {problem}")


class BagNotFound(BagNotReadable):
    """There is no such bag."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "no such file or folder")
