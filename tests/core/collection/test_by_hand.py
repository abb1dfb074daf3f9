"""Recording an arm that is guided by hand, in simulated time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from annik_core.collection.by_hand import ArmMoves, HandGuided, NotYetStill
from annik_core.errors import InvalidValue

NAMES = ("a", "b", "c")


def _guided(path: Path) -> HandGuided:
    return HandGuided(path, NAMES, still_tolerance=1e-3, still_time=0.5)


def _hold(guided: HandGuided, begin: float, positions: list[float]) -> None:
    for step in range(11):
        guided.update(begin + 0.06 * step, np.array(positions))


def test_rows_are_recorded_where_the_arm_stands_and_continued_later(tmp_path: Path) -> None:
    """In the format of a calibration; joints that have moved too little are named."""
    path = tmp_path / "placement_0" / "hole_0.csv"
    guided = _guided(path)
    _hold(guided, 0.0, [0.0, 0.1, 0.2])
    guided.record()
    assert guided.little_moved == ["a", "b", "c"]
    again = _guided(path)
    _hold(again, 5.0, [1.0, 0.1, 1.0 / 3.0])
    again.record()
    assert again.little_moved == ["b", "c"]
    assert np.loadtxt(path, delimiter=",").tolist() == [[0.0, 0.1, 0.2], [1.0, 0.1, 1.0 / 3.0]]


def test_an_arm_that_moves_or_is_unknown_is_not_recorded(tmp_path: Path) -> None:
    guided = _guided(tmp_path / "hole_0.csv")
    with pytest.raises(NotYetStill):
        guided.record()
    _hold(guided, 0.0, [0.0, 0.0, 0.0])
    guided.update(0.7, np.array([0.0, 0.002, 0.0]))
    with pytest.raises(ArmMoves) as refusal:
        guided.record()
    assert refusal.value.joint == "b"
    guided.update(0.8, None)
    guided.update(0.9, np.zeros(3))
    with pytest.raises(NotYetStill):
        guided.record()
    assert not guided.path.exists()


def test_a_file_of_another_arm_is_not_continued(tmp_path: Path) -> None:
    path = tmp_path / "hole_0.csv"
    path.write_text("1.0,2.0\n", encoding="utf-8")
    with pytest.raises(InvalidValue):
        _guided(path)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValue):
        _guided(tmp_path)
