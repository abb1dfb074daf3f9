"""Unique stamps for commands, and pairing of messages by stamp.

Stamps that name one command each, whatever the clock does.

Bring together what two topics say about the same stamp, in whichever order they arrive.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Generic, TypeVar

#: The last time that a ROS stamp can hold; it has 31 bits of seconds [ns].
LAST_STAMP = 2**31 * 1_000_000_000 - 1


class UniqueStamps:
    """Gives out strictly increasing stamps that follow a clock.

    Target, command and result are paired by their stamp, so two commands must never share one:
    not when the clock is coarse, and not when it is set back, as simulated time is on a restart.
    """

    def __init__(self) -> None:
        """Start with no stamp given out."""
        self._last: int | None = None

    def next(self, now: int) -> int:
        """``now`` [ns], or one nanosecond after the last stamp if that is later.

        After the last stamp that a message can hold they begin again with the clock: a clock that
        once showed nonsense, such as a time later than that, must not end all commands.
        """
        now = min(now, LAST_STAMP)
        if self._last is not None and now <= self._last < LAST_STAMP:
            now = self._last + 1
        self._last = now
        return now


First = TypeVar("First")
Second = TypeVar("Second")
Item = TypeVar("Item")

#: How many items of each kind wait for their partner before the oldest is given up.
DEFAULT_CAPACITY = 1000


class StampPairing(Generic[First, Second]):
    """Pairs items of two kinds that carry exactly the same stamp [ns].

    An item that finds its partner leaves with it. One whose partner never comes is given up when
    ``capacity`` newer ones of its kind wait, so that memory stays bounded. A second item of the
    same kind and stamp replaces the first one.

    Attributes:
        capacity: how many items of each kind may wait.
        given_up: how many items left without a partner, replaced ones included.
    """

    def __init__(self, capacity: int = DEFAULT_CAPACITY) -> None:
        """Start with nothing waiting; ``capacity`` is at least 1."""
        self.capacity = max(1, capacity)
        self.given_up = 0
        self._first: OrderedDict[int, First] = OrderedDict()
        self._second: OrderedDict[int, Second] = OrderedDict()

    @property
    def waiting(self) -> tuple[int, int]:
        """How many items of the first and of the second kind wait for their partner."""
        return len(self._first), len(self._second)

    def add_first(self, stamp: int, item: First) -> tuple[First, Second] | None:
        """Take an item of the first kind; the pair, if its partner is here."""
        if stamp in self._second:
            return item, self._second.pop(stamp)
        self._keep(self._first, stamp, item)
        return None

    def add_second(self, stamp: int, item: Second) -> tuple[First, Second] | None:
        """Take an item of the second kind; the pair, if its partner is here."""
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
