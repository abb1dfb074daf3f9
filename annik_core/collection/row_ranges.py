"""Rows of a plan in few words, such as ``0-4, 7``."""

from collections.abc import Iterable
from itertools import groupby


def row_ranges(rows: Iterable[int]) -> str:
    """The rows as ranges; empty for none."""
    ranges = []
    # Rows that follow each other differ from their places by the same number.
    for _, group in groupby(enumerate(sorted(set(rows))), lambda pair: pair[1] - pair[0]):
        members = [row for _, row in group]
        last = f"-{members[-1]}" if len(members) > 1 else ""
        ranges.append(f"{members[0]}{last}")
    return ", ".join(ranges)


def rows_in(text: str, count: int) -> frozenset[int]:
    """The rows below ``count`` that such words name.

    Raises:
        ValueError: if they are other words.
    """
    rows: set[int] = set()
    for part in filter(None, (part.strip() for part in text.split(","))):
        first, _, last = part.partition("-")
        rows.update(range(int(first), min(int(last or first), count - 1) + 1))
    return frozenset(rows)
