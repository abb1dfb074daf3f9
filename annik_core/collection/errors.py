"""Exceptions of a collection of measured examples."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from pathlib import Path

from annik_core.errors import AnnikError


class JournalMismatch(AnnikError):
    """A journal belongs to another plan or robot, or to another number of samples."""

    def __init__(self, path: Path, what: str, journal: object, given: object) -> None:
        self.path = path
        self.what = what
        self.journal = journal
        self.given = given
        super().__init__(
            f"journal {path} was begun with {what} {journal}, not {given}: give the same to "
            "continue it, or another dataset to begin a new one"
        )


class StopCause(Enum):
    """Why a collection stops."""

    OUTSIDE_LIMITS = "outside limits"
    SILENCE = "no joint states"
    JUMP = "jump of a measured joint"
    LAG = "robot does not follow"
    WRONG_PLACE = "robot is not at its command"
    FAILURES = "too many failed examples"


class CollectionStopped(AnnikError):
    """The robot or the set-up is at fault, so that no more commands are published."""

    def __init__(self, cause: StopCause, reason: str) -> None:
        self.cause = cause
        self.reason = reason
        super().__init__(
            f"stopped: {reason}; what was measured is kept, and the same command continues from "
            "there once the cause is removed"
        )


class CollectionIncomplete(AnnikError):
    """Some examples could not be measured.

    Attributes:
        missing: row of the plan to the reason of its last failure.
    """

    def __init__(self, missing: Mapping[int, str]) -> None:
        self.missing = dict(missing)
        first = "; ".join(f"row {row}: {reason}" for row, reason in sorted(missing.items())[:3])
        more = "; ..." if len(missing) > 3 else ""
        super().__init__(
            f"{len(missing)} examples could not be measured ({first}{more}): the same command "
            "visits them again, and keeps the others"
        )
