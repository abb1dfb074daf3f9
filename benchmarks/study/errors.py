"""Exceptions of studies."""

from __future__ import annotations

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
