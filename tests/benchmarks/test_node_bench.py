"""``./run bench node``: a quick run of all of it, and its arithmetic."""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import Pose
from rclpy.serialization import deserialize_message
from support.processes import LONG_PATIENCE, ROOT, run_python

from annik_core.robots.library import load_robot
from benchmarks.conditions import Conditions
from benchmarks.node.page import command, node_bench_page
from benchmarks.node.process_usage import cpu_seconds, resident_megabytes
from benchmarks.node.results import (
    MemoryResult,
    NodeBenchResults,
    RoundTripResult,
    StartResult,
    StreamResult,
    Summary,
)
from benchmarks.node.round_trip import _turns
from benchmarks.node.settings import QUICK, NodeBenchSettings
from benchmarks.node.streams import ages_of
from benchmarks.node.target_stream import Stream, _published
from benchmarks.node.targets import pose_to_bytes, random_poses
from msg_tools.conversions.pose import pose_to_array


def numbers_of(data: object) -> list[float]:
    """All numbers of plain data."""
    if isinstance(data, dict):
        return [number for value in data.values() for number in numbers_of(value)]
    if isinstance(data, list):
        return [number for value in data for number in numbers_of(value)]
    return [float(data)] if isinstance(data, (int, float)) else []


@pytest.mark.process
@pytest.mark.slow
def test_a_quick_run_measures_everything(tmp_path: Path) -> None:
    result = run_python(
        *("-m", "benchmarks.node", "--quick", "--out", "."),
        cwd=tmp_path,
        environment={"PYTHONPATH": str(ROOT)},
        patience=LONG_PATIENCE,
    )
    assert result.returncode == 0, result.stderr
    page = (tmp_path / "node_bench.md").read_text(encoding="utf-8")
    assert page.startswith("<!-- Written by ./run bench node --quick -->\n")
    assert page in result.stdout
    data = json.loads((tmp_path / "node_bench.json").read_text(encoding="utf-8"))
    numbers = numbers_of(data)
    assert len(numbers) > 50
    assert all(map(math.isfinite, numbers))
    for part, rows in (("round_trips", 8), ("streams", 2), ("memory", 2), ("starts", 2)):
        assert len(data[part]) == rows
    for found in data["round_trips"]:
        assert found["unanswered"] < found["asked"] / 2
        assert found["time"]["p50"] > 0
    for found in data["streams"]:
        assert 0 < found["answered"] <= found["sent"]
        assert found["age"]["p50"] > 0
        assert found["reached_rate"] <= 1.05 * found["rate"]
    for found in data["memory"]:
        assert found["answers"] > 0
        assert found["begin"] <= found["largest"]
    assert all(found["worst"] > 0.1 for found in data["starts"])


@pytest.mark.process
def test_a_wrong_option_is_refused() -> None:
    result = run_python("-m", "benchmarks.node", "--rounds", 0)
    assert result.returncode == 2
    assert "Invalid value for '--rounds': 0 is not" in result.stderr


def results() -> NodeBenchResults:
    def round_trip(node: str, executor: str, p50: float) -> RoundTripResult:
        return RoundTripResult(node, executor, 1, Summary(p50, 2 * p50, 3 * p50), 50.0, 10, 0)

    return NodeBenchResults(
        settings=NodeBenchSettings(in_a_row=(1,)),
        conditions=Conditions("a processor", 2, "3.12", {}, 0.1, 1.0, "performance", "rmw"),
        round_trips=[
            round_trip("null node", "single_threaded", 400.0),
            round_trip("null node", "events", 200.0),
            round_trip("ik_node gantry", "events", 240.0),
        ],
        streams=[StreamResult("ik_node gantry", 1, 1e3, 999.0, 8, 6, Summary(1, 2, 3), 40.0)],
        memory=[MemoryResult("ik_node gantry", 10.0, 600_000, 100.0, 100.25, 100.5)],
        starts=[StartResult("ik_node gantry", 3, 0.75, 1.0, 1.25)],
        skipped=["ik_node ur5e: no Pinocchio"],
    )


def test_the_page_compares_with_the_null_node() -> None:
    page = node_bench_page(results())
    assert page.startswith("<!-- Written by ./run bench node -->\n")
    assert "targets of the other nodes between any two" in page
    assert "| ik_node gantry | events | 240 | 480 | 1.20 | 1.20 | 0.60 | 50 | 0 |" in page
    assert "| ik_node gantry | 1000 | 1 | 999 | 8 | 6 | 75.000 | 1.00 | 2.00 | 3.0 | 40 |" in page
    assert "| ik_node gantry | 10 | 600000 | 100.00 | 100.25 | 100.50 | 0.25 |" in page
    assert "| ik_node gantry | 3 | 0.75 | 1.00 | 1.25 |" in page
    assert "governor performance" in page
    assert "no Pinocchio" in page


def test_the_page_says_how_it_was_made() -> None:
    assert command(QUICK) == "./run bench node --quick"
    assert command(NodeBenchSettings(rounds=7)) == "./run bench node --rounds 7"
    assert command(NodeBenchSettings(memory_minutes=0.5)) == (
        "./run bench node --memory-minutes 0.5"
    )


def test_a_summary_of_times() -> None:
    assert Summary.of(np.arange(101.0)) == Summary(50.0, 99.0, 100.0)
    assert math.isnan(Summary.of([]).p99)


def test_ages_count_answered_targets_only() -> None:
    times = np.array([1_000_000_000, 2_000_000_000, 3_000_000_000])
    places = {0.1: 0, 0.2: 1, 0.3: 2, 0.4: 3}
    answers = [(0.1, 1_500_000_000), (0.3, 3_000_100_000), (0.4, 9), (0.5, 9)]
    np.testing.assert_allclose(ages_of(times, answers, places), [0.5, 1e-4])
    assert ages_of(times, [], places).size == 0


def test_targets_are_the_bytes_of_messages_and_told_apart_by_x() -> None:
    poses = random_poses(load_robot("gantry"), 500, np.random.default_rng(0))
    assert poses.shape == (500, 7)
    assert len(set(poses[:, 0].tolist())) == 500
    message = deserialize_message(pose_to_bytes(poses[3]), Pose)
    np.testing.assert_array_equal(pose_to_array(message), poses[3])


class SlowPublisher:
    """Keeps what is published, and is once kept waiting."""

    def __init__(self, stall_at: int, stall: float) -> None:
        self.published: list[bytes] = []
        self._stall_at = stall_at
        self._stall = stall

    def publish(self, data: bytes) -> None:
        self.published.append(data)
        if len(self.published) == self._stall_at:
            time.sleep(self._stall)


def test_a_stream_that_was_late_does_not_catch_up() -> None:
    publisher = SlowPublisher(10, 0.05)
    times = _published(publisher, Stream("/t", 1000.0, 50, [b"a", b"b"], b"p"))
    assert publisher.published == [b"a", b"b"] * 25
    assert 1e-9 * (times[-1] - times[0]) > 0.049 + 0.045


@pytest.mark.parametrize("in_a_row", [1, 4, 100])
def test_turns_hold_every_target_once_and_keep_the_warm_up_apart(in_a_row: int) -> None:
    turns = list(_turns(10, 25, in_a_row))
    assert [number for turn in turns for number in range(turn.start, turn.stop)] == list(range(35))
    assert all(turn.stop - turn.start <= in_a_row for turn in turns)
    assert any(turn.start == 10 for turn in turns)


def test_usage_of_a_process() -> None:
    end = time.process_time() + 0.05
    while time.process_time() < end:
        pass
    assert cpu_seconds(os.getpid()) == pytest.approx(time.process_time(), abs=1.0)
    assert 5.0 < resident_megabytes(os.getpid()) < 5000.0
