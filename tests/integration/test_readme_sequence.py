"""The README's commands, one after the other."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from support.processes import wait_until

from msg_tools.bags.reader import read_bag
from msg_tools.report.write import write_report


def _recorded_errors(bag: Path) -> int:
    topics = read_bag(bag).topics
    names = ("/tracking_error/position", "/tracking_error/orientation")
    return min(topics[name].message_count if name in topics else 0 for name in names)


def test_the_bag_holds_every_target_and_what_came_of_it(
    launch: Callable[..., Any], tmp_path: Path
) -> None:
    bag = tmp_path / "my_bag"
    launch("ik_node")
    launch("fake_robot")
    recorder = launch("bag_recorder", "-p", f"output:={bag}")
    # Slower than by default: of targets that wait, ik_node takes the newest only.
    publisher = launch("target_publisher", "-p", "wait_for_subscribers:=2", "-p", "rate:=3.0")
    assert publisher.wait_for_exit() == 0
    # The last target is delivered when its publisher ends; what comes of it is still on its way.
    wait_until(lambda: _recorded_errors(bag) >= 15, "the errors of all targets in the bag")
    recorder.signal(signal.SIGINT)
    assert recorder.wait_for_exit() == 0
    results = write_report(bag, tmp_path / "report").to_dict()
    assert (
        results["targets_sent"] == results["targets_answered"] == results["targets_paired"] == 15
    )
    assert results["latency_us"]["p50"] > 0
    assert results["position_error_mm"]["max"] < 0.25
