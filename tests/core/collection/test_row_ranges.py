"""Rows of a plan in few words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.collection.row_ranges import row_ranges, rows_in


@pytest.mark.parametrize(
    ("rows", "words"), [([], ""), ([3], "3"), ([2, 0, 1, 7], "0-2, 7"), ([5, 5, 6], "5-6")]
)
def test_some_rows(rows: list[int], words: str) -> None:
    assert row_ranges(rows) == words


@given(st.sets(st.integers(0, 60)), st.integers(0, 70))
def test_the_words_name_the_rows_below_the_count(rows: set[int], count: int) -> None:
    assert rows_in(row_ranges(rows), count) == {row for row in rows if row < count}


def test_few_words_name_at_most_the_rows_of_the_plan() -> None:
    assert len(rows_in("0-999999999999", 10)) == 10


@pytest.mark.parametrize("words", ["x", "-3", "1;2", "1-2-3"])
def test_other_words_are_no_rows(words: str) -> None:
    with pytest.raises(ValueError):
        rows_in(words, 10)
