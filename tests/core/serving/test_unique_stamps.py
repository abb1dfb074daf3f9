"""Unique stamps. Needs no ROS."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from annik_core.serving.stamps import UniqueStamps


def test_a_running_clock_is_followed_exactly() -> None:
    """The stamp is the time, unless that was given out before."""
    stamps = UniqueStamps()
    assert [stamps.next(now) for now in (5, 6, 100)] == [5, 6, 100]


def test_a_clock_that_stands_still_or_goes_back_gives_new_stamps() -> None:
    """Each is one nanosecond after the last."""
    stamps = UniqueStamps()
    assert [stamps.next(now) for now in (5, 5, 0, 6, 9)] == [5, 6, 7, 8, 9]


@given(st.lists(st.integers(-(10**18), 10**18), max_size=50))
def test_stamps_strictly_increase_whatever_the_clock_does(times: list[int]) -> None:
    """No two commands share a stamp, and no stamp is before its time."""
    stamps = UniqueStamps()
    given_out = [stamps.next(now) for now in times]
    assert all(before < after for before, after in pairwise(given_out))
    assert all(stamp >= now for stamp, now in zip(given_out, times, strict=True))


def test_after_the_last_stamp_there_is_they_begin_again_with_the_clock() -> None:
    """A clock that showed the end of time, and then the right one, must not end all commands."""
    last = 2**31 * 1_000_000_000 - 1
    stamps = UniqueStamps()
    assert [stamps.next(now) for now in (5, last, 7, 7)] == [5, last, 7, 8]
