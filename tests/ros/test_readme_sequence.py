"""The README's commands, one after the other."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

from msg_tools.report import write_report


def test_the_bag_holds_every_target_and_what_came_of_it(
    launch: Callable[..., Any], tmp_path: Path
) -> None:
    bag = tmp_path / "my_bag"
    launch("ik_node")
    launch("fake_robot_node")
    recorder = launch("bag_recorder", "-p", f"output:={bag}")
    publisher = launch("target_publisher", "-p", "wait_for_subscribers:=2")
    assert publisher.wait_for_exit() == 0
    recorder.process.send_signal(signal.SIGINT)
    assert recorder.wait_for_exit() == 0
    results = write_report(bag, tmp_path / "report").results()
    assert (
        results["targets_sent"] == results["targets_answered"] == results["targets_paired"] == 15
    )
    assert results["latency_us"]["p50"] > 0
    assert results["position_error_mm"]["max"] < 0.25
