"""The order of the examples is short and always the same. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from annik_core.collection.visiting_order import visiting_order


def travel_length(start: np.ndarray, joint_positions: np.ndarray, order: tuple[int, ...]) -> float:
    """How far the joint that moves furthest travels from ``start`` through rows in this order."""
    path = np.vstack([start, joint_positions[list(order)]])
    return float(np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0).sum())


def places(count: st.SearchStrategy[int]) -> st.SearchStrategy[np.ndarray]:
    return count.flatmap(lambda n: arrays(np.float64, (n, 3), elements=st.floats(-3, 3, width=32)))


@given(places(st.integers(1, 20)))
def test_every_place_is_visited_once_by_a_way_not_longer_than_the_given_one(points) -> None:
    start, others = points[0], points[1:]
    order = visiting_order(start, others)
    assert sorted(order) == list(range(len(others)))
    given_order = tuple(range(len(others)))
    shortest = travel_length(start, others, order)
    assert shortest <= travel_length(start, others, given_order) + 1e-9
    assert order == visiting_order(start.copy(), others.copy())


def test_places_in_a_row_are_visited_from_the_start_to_the_other_end() -> None:
    others = np.array([[3.0], [1.0], [4.0], [2.0]])
    assert visiting_order(np.array([0.0]), others) == (1, 3, 0, 2)


def test_continuous_joints_go_the_shorter_way_around() -> None:
    """-3.1 is next to 3.1, as if it were 3.18; another joint is not turned."""
    others = np.array([[0.5, 0.0], [-3.1, 0.0], [3.1, 0.0], [2.5, 0.0], [-2.5, 0.0]])
    start = np.array([2.4, 0.0])
    assert visiting_order(start, others, turning=[0]) == (3, 2, 1, 4, 0)
    assert visiting_order(start, others, turning=[1]) == visiting_order(start, others)


def test_many_places_take_a_fraction_of_the_way_through_them_as_given() -> None:
    rng = np.random.default_rng(0)
    start, others = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, (200, 6))
    order = visiting_order(start, others)
    given_order = tuple(range(200))
    assert travel_length(start, others, order) < 0.65 * travel_length(start, others, given_order)


def test_the_way_is_as_long_as_the_joint_that_moves_furthest() -> None:
    others = np.array([[1.0, 0.5], [1.0, -1.5]])
    assert travel_length(np.zeros(2), others, (0, 1)) == pytest.approx(1.0 + 2.0)
