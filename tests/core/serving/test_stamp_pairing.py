"""Pairing by stamp. Needs no ROS."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from annik_core.serving.stamps import StampPairing


def test_a_pair_is_found_whichever_comes_first() -> None:
    """The order of arrival does not change the order within the pair."""
    pairing: StampPairing[str, str] = StampPairing()
    assert pairing.add_first(1, "target") is None
    assert pairing.add_second(1, "achieved") == ("target", "achieved")
    assert pairing.add_second(2, "achieved") is None
    assert pairing.add_first(2, "target") == ("target", "achieved")


def test_a_paired_item_is_used_once() -> None:
    """A partner that came is gone."""
    pairing: StampPairing[str, str] = StampPairing()
    pairing.add_first(1, "target")
    pairing.add_second(1, "achieved")
    assert pairing.add_second(1, "again") is None
    assert pairing.waiting == (0, 1)


def test_neighbouring_stamps_are_not_a_pair() -> None:
    """One nanosecond apart is another command."""
    pairing: StampPairing[str, str] = StampPairing()
    pairing.add_first(10**18, "target")
    assert pairing.add_second(10**18 + 1, "achieved") is None


def test_a_second_item_with_the_same_stamp_replaces_the_first() -> None:
    """The newer one is paired; the older one counts as given up, even if it was None."""
    pairing: StampPairing[str | None, str] = StampPairing()
    pairing.add_first(1, None)
    pairing.add_first(1, "new")
    assert pairing.given_up == 1
    assert pairing.add_second(1, "achieved") == ("new", "achieved")


def test_the_oldest_is_given_up_when_too_many_wait() -> None:
    """Each kind has its own room."""
    pairing: StampPairing[int, int] = StampPairing(capacity=2)
    for stamp in (1, 2, 3):
        pairing.add_first(stamp, stamp)
    assert pairing.waiting == (2, 0)
    assert pairing.given_up == 1
    assert pairing.add_second(1, 1) is None
    assert pairing.add_second(2, 2) == (2, 2)


@given(st.permutations([(kind, stamp) for kind in (0, 1) for stamp in range(8)]))
def test_every_stamp_is_paired_exactly_once_in_any_order(events: list[tuple[int, int]]) -> None:
    """Whatever the order of arrival, nothing is lost and nothing is paired twice."""
    pairing: StampPairing[int, int] = StampPairing()
    add = (pairing.add_first, pairing.add_second)
    pairs = [pair for kind, stamp in events if (pair := add[kind](stamp, stamp)) is not None]
    assert sorted(pairs) == [(stamp, stamp) for stamp in range(8)]
    assert pairing.waiting == (0, 0)
    assert pairing.given_up == 0


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 50))), st.integers(1, 5))
def test_memory_is_bounded(events: list[tuple[bool, int]], capacity: int) -> None:
    """However many stay alone, no more than the capacity of each kind is kept."""
    pairing: StampPairing[int, int] = StampPairing(capacity)
    for is_first, stamp in events:
        (pairing.add_first if is_first else pairing.add_second)(stamp, stamp)
        assert max(pairing.waiting) <= capacity
