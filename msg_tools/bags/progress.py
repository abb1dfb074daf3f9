"""How whoever waits for a long bag learns of its progress."""

from collections.abc import Iterable
from typing import Protocol, TypeVar

_Item = TypeVar("_Item")


class Progress(Protocol):
    """Passes items on, and shows how many of them have come by."""

    def __call__(self, items: Iterable[_Item], what: str, total: int | None) -> Iterable[_Item]:
        """The same items. ``what`` is done with them, in words; ``total``: None if unknown."""
        ...


def not_shown(items: Iterable[_Item], what: str, total: int | None) -> Iterable[_Item]:
    """Shows nothing."""
    return items
