"""Exceptions of studies."""

from __future__ import annotations

from pathlib import Path

from annik_core.errors import AnnikError


class StudyError(AnnikError):
    """A study can't be run as asked."""


class InvalidStudySetting(StudyError):
    """What is to be compared makes no sense."""

    def __init__(self, setting: str, value: object, allowed: str) -> None:
        self.setting = setting
        self.value = value
        self.allowed = allowed
        super().__init__(f"{setting} is {value!r}; allowed: {allowed}")


class StudyInUse(StudyError):
    """Another study writes to the same folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__(
            f"{path} is in use by another study: wait until it ends, or give another --out"
        )


class DamagedStudyResults(StudyError):
    """A line of a file of results is not as annik wrote it."""

    def __init__(self, path: Path, line: int, problem: str) -> None:
        self.path = path
        self.line = line
        super().__init__(
            f"results {path}, line {line}: {problem}; delete this line (its job is then run "
            "again), or give another --out"
        )


class StudyNotWritable(StudyError):
    """What a study found can't be written."""

    def __init__(self, path: Path, reason: str) -> None:
        self.path = path
        self.reason = reason
        super().__init__(
            f"{path} can't be written ({reason}): check the folder and free space; what was "
            "written before is kept, and the same command goes on from there"
        )
