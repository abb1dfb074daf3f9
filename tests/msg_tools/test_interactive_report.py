"""The interactive page holds the report's numbers, stays small, and opens without a server."""

from __future__ import annotations

import json
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from support.robot_recording import RobotRecording, diagnostics

pytest.importorskip(
    "plotly", reason="the interactive report needs plotly: pip install 'annik_ros[view]'"
)

from annik_training.cli.report import report as command
from docs.browser import browser, chromium
from msg_tools.bags.reader import read_bag
from msg_tools.report.interactive import MAX_DRAWN, drawn_targets, interactive_page, page_data
from msg_tools.report.tracking import TargetResult, tracking_report

EXECUTABLE = chromium()
LARGEST_PAGE = 5_000_000
MakeRecording = Callable[..., RobotRecording]


class Scripts(HTMLParser):
    """Collects the scripts by their id, and whatever a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: dict[str, str] = {}
        self.loaded: list[str] = []
        self._script: str | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.loaded += [value or "" for name, value in attrs if name in ("src", "href")]
        self._script = str(dict(attrs).get("id")) if tag == "script" else None

    def handle_data(self, data: str) -> None:
        if self._script is not None:
            self.texts[self._script] = data

    def handle_endtag(self, tag: str) -> None:
        self._script = None


def add_refusals(recording: RobotRecording, number: int, reasons: dict[str, int]) -> None:
    values = {f"refused: {reason}": str(count) for reason, count in reasons.items()}
    values["targets refused"] = str(sum(reasons.values()))
    stamp = recording.stamp(number)
    recording.add("/diagnostics", diagnostics(stamp, "ik_node: targets", values), stamp)


def results(count: int) -> list[TargetResult]:
    return [
        TargetResult(
            number=number,
            stamp_ns=number,
            target=(0.0, 0.0, 0.0),
            achieved=(0.0, 0.0, 0.0),
            position_error_mm=1.0 + (number == count - 7),
            orientation_error_deg=1.0 + (number == count // 2),
            latency_us=None if number % 3 else 1.0 + (number == 999),
        )
        for number in range(1, count + 1)
    ]


def test_the_page_has_the_numbers_of_the_report(tmp_path: Path, recording: MakeRecording) -> None:
    robot = recording(count=12, refused=(3, 4, 5))
    for number, reasons in ((2, {}), (3, {"a </script>": 1}), (6, {"a </script>": 2, "b": 1})):
        add_refusals(robot, number, reasons)
    bag, page = robot.write(tmp_path / "bag"), tmp_path / "pages" / "page.html"
    run = CliRunner().invoke(command, [str(bag), "--html", str(page)], catch_exceptions=False)
    assert str(page) in run.output
    assert (bag / "report" / "errors.png").is_file()

    scripts = Scripts()
    scripts.feed(page.read_text())
    assert scripts.loaded == []
    shown: dict[str, Any] = json.loads(scripts.texts["page"])
    report = tracking_report(read_bag(bag))
    assert shown["targets"]["number"] == [target.number for target in report.targets]
    for column in ("position_error_mm", "orientation_error_deg", "latency_us"):
        assert shown["targets"][column] == [getattr(target, column) for target in report.targets]
    for axis, name in enumerate("xyz"):
        assert shown["targets"][name] == [target.target[axis] for target in report.targets]
        assert shown["targets"][f"achieved_{name}"] == [t.achieved[axis] for t in report.targets]
    assert shown["targets"]["seconds"][-1] == pytest.approx(0.11)
    assert shown["refusals"]["seconds"] == pytest.approx([0.02, 0.03, 0.06])
    assert shown["refusals"]["counts"] == {"a </script>": [0, 1, 2], "b": [0, 0, 1]}
    # 0.1 mm becomes 0.1 m, on a path of 1 m.
    assert shown["magnification"] == 1000


@pytest.mark.parametrize("count", [MAX_DRAWN, MAX_DRAWN + 1, 250_000])
def test_of_many_targets_the_extremes_are_drawn(count: int) -> None:
    targets = results(count)
    drawn = drawn_targets(targets)
    assert len(drawn) <= MAX_DRAWN
    numbers = [target.number for target in drawn]
    assert numbers == sorted(set(numbers))
    assert {1, count - 7, count // 2, 999} <= set(numbers)


def test_the_page_of_any_bag_stays_small(tmp_path: Path, recording: MakeRecording) -> None:
    """With as many targets as are ever drawn; without any it is a page too."""
    report = tracking_report(read_bag(recording(count=3).write(tmp_path / "some")))
    many = [target for number in range(2000) for target in report.targets]
    object.__setattr__(report, "targets", tuple(many))
    assert 1_000_000 < len(interactive_page(report).encode()) < LARGEST_PAGE
    report = tracking_report(read_bag(recording(count=0).write(tmp_path / "none")))
    assert page_data(report)["targets"]["number"] == []
    assert "nothing to compare" in interactive_page(report)


@pytest.mark.process
@pytest.mark.slow
@pytest.mark.skipif(EXECUTABLE is None, reason="no Chromium: apt install chromium")
def test_the_page_opens_from_a_file(tmp_path: Path, recording: MakeRecording) -> None:
    pytest.importorskip("playwright", reason="a browser is driven by playwright")
    assert EXECUTABLE is not None
    robot = recording(count=40, refused=(3,))
    add_refusals(robot, 3, {"outside workspace": 1})
    path = tmp_path / "page.html"
    path.write_text(interactive_page(tracking_report(read_bag(robot.write(tmp_path / "bag")))))
    with browser(EXECUTABLE) as tab:
        faults: list[str] = []
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.on("console", lambda said: faults.append(said.text) if said.type == "error" else None)
        tab.goto(path.as_uri())
        tab.wait_for_selector("#state", state="detached")
        assert tab.locator(".js-plotly-plot").count() == 3
        tab.check("#logarithmic")
        tab.select_option("#magnification", "100")
        tab.wait_for_function(
            "Math.abs(document.getElementById('path').data[1].x[0] - 0.01) < 1e-9"
        )
        assert faults == []
