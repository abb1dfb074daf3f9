"""A report's files say what the report says, and replace an earlier one whole or not at all."""

from __future__ import annotations

import csv
import errno
import json
import os
import struct
from html.parser import HTMLParser
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from support.robot_recording import RobotRecording

from annik_core.errors import NotWritable
from msg_tools.bags.reader import read_bag
from msg_tools.report.table import print_report
from msg_tools.report.tracking import TrackingReport, tracking_report
from msg_tools.report.write import write_report

PNG_FILES = {"errors.png", "path.png", "histogram.png", "latency.png"}
FILES = PNG_FILES | {"report.html", "results.json", "targets.csv"}


class Links(HTMLParser):
    """Collects what a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href")]


def png_size(content: bytes) -> tuple[int, int]:
    assert content.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", content[16:24])
    return width, height


def printed(report: TrackingReport) -> str:
    console = Console(file=StringIO(), width=120)
    print_report(report, console)
    return console.file.getvalue()  # type: ignore[attr-defined]


def test_all_files_are_written_and_agree(tmp_path: Path) -> None:
    recording = RobotRecording(count=12, refused=(3,))
    recording.add_diagnostics({"outside <the> workspace": 1})
    report = write_report(recording.write(tmp_path / "bag"), tmp_path / "out" / "report")
    out = tmp_path / "out" / "report"
    assert {path.name for path in out.iterdir()} == FILES
    for name in PNG_FILES:
        assert min(png_size((out / name).read_bytes())) > 200

    results = json.loads((out / "results.json").read_text())
    assert results["targets_sent"] == 12
    assert results["targets_answered"] == 11
    assert results["targets_unanswered"] == 1
    assert results["targets_refused"] == 1
    assert results["position_error_mm"].keys() >= {"p50", "p95", "max"}
    assert results["position_error_mm"]["max"] == pytest.approx(0.1)
    assert results["orientation_error_deg"]["max"] == pytest.approx(0.01)
    assert results["latency_us"] == {"p50": 500.0, "p95": 500.0, "p99": 500.0, "max": 500.0}

    page = (out / "report.html").read_text()
    links = Links()
    links.feed(page)
    assert len(links.found) == len(PNG_FILES)
    assert all(link.startswith("data:image/png;base64,") for link in links.found)
    assert "outside &lt;the&gt; workspace" in page

    with (out / "targets.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["x_m"]) for row in rows] == [target.target[0] for target in report.targets]

    text = printed(report)
    assert "0.1000" in text
    assert "outside <the> workspace: 1" in text


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 1, 2, 1500])
def test_bags_of_any_size_have_a_report(tmp_path: Path, count: int) -> None:
    report = write_report(RobotRecording(count=count).write(tmp_path / "bag"), tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    page = (tmp_path / "out" / "report.html").read_text()
    assert ("nothing to compare" in page) == (count == 0)
    assert ("targets.csv holds all" in page) == (count > 1000)
    assert len(printed(report).splitlines()) < 50


@pytest.mark.slow
def test_errors_over_decades_and_without_errors_can_be_drawn(tmp_path: Path) -> None:
    recording = RobotRecording(count=60)
    for number, message in enumerate(recording.messages):
        if message.relative_topic == "achieved_pose":
            message.content.pose.position.y += 1e-9 * 1.3 ** (number / 5)
    write_report(recording.write(tmp_path / "wide"), tmp_path / "out")

    recording = RobotRecording(count=20)
    recording.achieved = recording.target  # type: ignore[method-assign]
    recording.messages.clear()
    recording.__post_init__()
    report = write_report(recording.write(tmp_path / "exact"), tmp_path / "out")
    assert report.position_error_mm is not None
    assert report.position_error_mm.max == 0.0


def test_unanswered_and_refused_targets_are_shown_apart(tmp_path: Path) -> None:
    recording = RobotRecording(count=20, refused=range(3, 10))
    recording.add_diagnostics({"not finite": 5})
    report = write_report(recording.write(tmp_path / "bag"), tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<b>7</b> unanswered" in page
    assert "<b>5</b> refused" in page
    text = printed(report)
    assert "unanswered" in text
    (row,) = (line for line in text.splitlines() if "not finite: 5" in line)
    assert [word for word in row.split() if word.isdigit()] == ["20", "13", "7", "5", "5"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e308, -1e200, 1e6, 1e-320])
def test_numbers_beyond_all_measure_neither_stop_a_report_nor_enter_it(
    tmp_path: Path, value: float
) -> None:
    """In achieved poses and in recorded errors; results.json stays JSON, which has no NaN."""
    recording = RobotRecording(count=10)
    for message in recording.messages[::3]:
        if message.relative_topic == "achieved_pose":
            message.content.pose.position.y = value
        if message.relative_topic.startswith("tracking_error"):
            message.content.vector.z = value
    write_report(recording.write(tmp_path / "bag"), tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES

    def refuse(constant: str) -> None:
        pytest.fail(f"{constant} is not JSON")

    text = (tmp_path / "out" / "results.json").read_text()
    results = json.loads(text, parse_constant=refuse)
    assert results["targets_paired"] > 0


def test_errors_of_next_to_nothing_can_be_drawn(tmp_path: Path) -> None:
    recording = RobotRecording(count=6)
    recording.target = lambda number: np.array([0, 0, 0, 0, 0, 0, 1.0])  # type: ignore[method-assign]
    recording.achieved = lambda number: np.array(  # type: ignore[method-assign]
        [5e-324 * 10**number, 0, 0, 0, 0, 0, 1.0]
    )
    recording.messages.clear()
    recording.__post_init__()
    report = write_report(recording.write(tmp_path / "bag"), tmp_path / "out")
    assert len(report.targets) == 6


def test_no_pairs_are_numbers_of_none_in_json(tmp_path: Path) -> None:
    recording = RobotRecording(count=3).without("achieved_pose")
    report = write_report(recording.write(tmp_path / "bag"), tmp_path / "out")
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["position_error_mm"] == dict.fromkeys(("p50", "p95", "p99", "max"))
    assert "/achieved_pose" in (tmp_path / "out" / "report.html").read_text()
    assert "/achieved_pose" in printed(report)


def test_an_output_that_can_not_be_written_is_a_typed_error(tmp_path: Path) -> None:
    bag = RobotRecording(count=3).write(tmp_path / "bag")
    (tmp_path / "file").write_text("")
    for output in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(NotWritable) as caught:
            write_report(bag, output)
        assert caught.value.path == output


def test_a_report_that_fails_half_way_keeps_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    write_report(RobotRecording(count=3).write(tmp_path / "first"), out)
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    second = RobotRecording(count=7).write(tmp_path / "second")
    write = Path.write_bytes

    def full_disk(path: Path, content: bytes) -> int:
        if "results.json" in path.name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(NotWritable) as caught:
        write_report(second, out)
    assert (caught.value.path, caught.value.reason) == (out, os.strerror(errno.ENOSPC))
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_a_report_is_the_same_each_time(tmp_path: Path) -> None:
    bag = RobotRecording(count=8).write(tmp_path / "bag")
    assert tracking_report(read_bag(bag)) == tracking_report(read_bag(bag))


def test_a_report_begins_with_why_targets_were_refused(tmp_path: Path) -> None:
    recording = RobotRecording(count=6, refused=range(6))
    last = "x is 2 m, the workspace is [0.2, 0.5] m"
    recording.add_diagnostics({"outside workspace": 5, "not finite": 1}, last=last)
    report = write_report(recording.write(tmp_path / "bag"), tmp_path / "out")
    assert report.last_refusal == last
    first, *rest = printed(report).splitlines()
    assert first.startswith("! 6 targets were refused: outside workspace (5), not finite (1).")
    assert last in f"{first} {rest[0]}"
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.index("6 targets were refused") < page.index("targets sent")
    assert not any("bag_recorder" in note for note in report.notes)


def test_a_report_without_refusals_says_nothing_of_them(tmp_path: Path) -> None:
    recording = RobotRecording(count=6)
    recording.add_diagnostics({})
    report = tracking_report(read_bag(recording.write(tmp_path / "bag")))
    assert report.why_refused == ""
    assert printed(report).splitlines()[0].strip() == "Targets"
