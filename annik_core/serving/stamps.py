"""Unique stamps for commands, and pairing of messages by stamp."""

from collections import OrderedDict
from typing import Generic, TypeVar

#: Latest time that a ROS stamp can hold, with 31 bits of seconds [ns].
LAST_STAMP = 2**31 * 1_000_000_000 - 1


class UniqueStamps:
    """Strictly increasing stamps that follow a clock, even one that is coarse or set back."""

    def __init__(self) -> None:
        self._last: int | None = None

    def next(self, now: int) -> int:
        """``now`` [ns], or one nanosecond after the last stamp if that is later.

        After :data:`LAST_STAMP` they follow the clock again, so that one wrong reading of the
        clock does not end all commands.
        """
        now = min(now, LAST_STAMP)
        if self._last is not None and now <= self._last < LAST_STAMP:
            now = self._last + 1
        self._last = now
        return now


First = TypeVar("First")
Second = TypeVar("Second")
Item = TypeVar("Item")

#: Most items of each kind that wait for their partners.
DEFAULT_CAPACITY = 1000


class StampPairing(Generic[First, Second]):
    """Pairs items of two kinds that carry exactly the same stamp [ns], in any order of arrival.

    An item without a partner is given up when ``capacity`` newer ones of its kind wait, so that
    memory stays bounded. A second item of the same kind and stamp replaces the first one.

    Attributes:
        given_up: number of items that left without a partner, replaced ones included.
    """

    def __init__(self, capacity: int = DEFAULT_CAPACITY) -> None:
        self.capacity = max(1, capacity)
        self.given_up = 0
        self._first: OrderedDict[int, First] = OrderedDict()
        self._second: OrderedDict[int, Second] = OrderedDict()

    @property
    def waiting(self) -> tuple[int, int]:
        """Number of items of the first and of the second kind that wait."""
        return len(self._first), len(self._second)

    def add_first(self, stamp: int, item: First) -> tuple[First, Second] | None:
        """Add an item of the first kind; the pair, if its partner waits."""
        if stamp in self._second:
            return item, self._second.pop(stamp)
        self._keep(self._first, stamp, item)
        return None

    def add_second(self, stamp: int, item: Second) -> tuple[First, Second] | None:
        """Add an item of the second kind; the pair, if its partner waits."""
        if stamp in self._first:
            return self._first.pop(stamp), item
        self._keep(self._second, stamp, item)
        return None

    def _keep(self, waiting: OrderedDict[int, Item], stamp: int, item: Item) -> None:
        if stamp in waiting:
            del waiting[stamp]
            self.given_up += 1
        waiting[stamp] = item
        if len(waiting) > self.capacity:
            waiting.popitem(last=False)
            self.given_up += 1
