"""Exceptions of a collection of measured examples."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from annik_core.errors import AnnikError


class CollectionError(AnnikError):
    """Examples can't be collected as asked."""


class DatasetInTheWay(CollectionError):
    """Where the measured examples are to go is a file that no journal tells of."""

    def __init__(self, path: Path, journal: Path) -> None:
        self.path = path
        self.journal = journal
        super().__init__(
            f"{path} is there, but not {journal.name} that would belong to it: give another "
            "dataset, or move this one away"
        )


class JournalMismatch(CollectionError):
    """A journal was begun for another plan, or with a setting that must stay."""

    def __init__(self, path: Path, what: str, journal: object, given: object) -> None:
        self.path = path
        self.what = what
        self.journal = journal
        self.given = given
        super().__init__(
            f"journal {path} was begun with {what} {journal}, not {given}: give what it was begun "
            "with, to go on with it, or another dataset, to begin anew"
        )


class CollectionStopped(CollectionError):
    """The robot did something that it should not: nothing is commanded any more."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(
            f"stopped: {reason}; what was measured is kept, and the same command goes on from "
            "there once the cause is found"
        )


class CollectionIncomplete(CollectionError):
    """Some examples could not be measured.

    Attributes:
        missing: row of the plan to the reason that it failed for last.
    """

    def __init__(self, missing: Mapping[int, str]) -> None:
        self.missing = dict(missing)
        first = "; ".join(f"row {row}: {reason}" for row, reason in sorted(missing.items())[:3])
        more = "; ..." if len(missing) > 3 else ""
        super().__init__(
            f"{len(missing)} examples could not be measured ({first}{more}): the same command "
            "tries them again, and keeps the others"
        )
