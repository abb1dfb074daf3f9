"""The report of a long bag: what it keeps in memory, and what it says of its progress."""

from __future__ import annotations

import tracemalloc
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest

from annik_training.cli.output import shown_progress
from benchmarks.long_bag import write_bag
from msg_tools.bags.reader import read_bag
from msg_tools.report.tracking import tracking_report

#: A bag of a million messages has to fit into this much memory [bytes].
MOST = 1e9
FEW, MORE = 2000, 6000


def peak(bag: Path) -> int:
    """Most memory that the report of a bag takes [bytes]."""
    tracemalloc.start()
    try:
        tracking_report(read_bag(bag))
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_million_messages_fit_into_memory(tmp_path: Path) -> None:
    first, second = write_bag(tmp_path / "few", FEW), write_bag(tmp_path / "more", MORE)
    # What is loaded and computed once counts for neither.
    tracking_report(read_bag(tmp_path / "few"))
    growth = (peak(tmp_path / "more") - peak(tmp_path / "few")) / (second - first)
    assert growth * 1e6 < MOST


def test_the_report_counts_what_was_written_and_shows_its_progress(tmp_path: Path) -> None:
    written = write_bag(tmp_path / "bag", 8000)
    totals: dict[str, int | None] = {}
    passed: Counter[str] = Counter()

    def progress(items: Iterable[Any], what: str, total: int | None) -> Iterator[Any]:
        totals[what] = total
        for item in items:
            passed[what] += 1
            yield item

    bag = read_bag(tmp_path / "bag", progress)
    report = tracking_report(bag, progress=progress)
    assert bag.complete and bag.message_count == written
    assert totals == passed == dict.fromkeys(totals, written) and len(totals) == 2
    assert report.targets_refused == 1 and report.targets_sent == len(report.targets) + 1
    assert report.position_error_mm is not None
    assert report.position_error_mm.max == pytest.approx(0.1)


def test_the_bar_is_for_a_terminal_only(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(shown_progress(range(3), "reading", 3)) == [0, 1, 2]
    assert capsys.readouterr() == ("", "")


def test_the_bar_names_what_is_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("TERM", "xterm")
    assert list(shown_progress(range(3), "reading", 3)) == [0, 1, 2]
    assert "reading" in capsys.readouterr().err
