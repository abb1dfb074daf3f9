"""The demo as its user runs it: every process real, every file there, every figure good enough."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader
from support.processes import LONG_PATIENCE, Process, run_python, wait_until

PICTURES = ("errors.png", "path.png", "histogram.png", "latency.png")


def processes_mentioning(text: str) -> list[str]:
    """Command lines of running processes that hold a text."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            line = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
        except (OSError, UnicodeDecodeError):
            continue
        if text in line and entry.name != str(os.getpid()):
            found.append(line)
    return found


@pytest.mark.slow
def test_demo(tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    result = run_python("-m", "examples.demo", "--out", folder, patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stdout + result.stderr
    assert processes_mentioning(str(folder)) == []

    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert (
        results["targets_sent"] == results["targets_answered"] == results["targets_paired"] == 141
    )
    assert results["targets_refused"] == 0
    assert results["position_error_mm"]["max"] < 0.25
    assert results["orientation_error_deg"]["max"] < 0.1
    assert 0 < results["latency_us"]["p50"] <= results["latency_us"]["p99"]
    assert results["training"]["examples"] == 179
    assert results["training"]["seconds"] > 0

    for name in ("model.onnx", "report.html", "bag/metadata.yaml", *PICTURES):
        assert (folder / name).stat().st_size > 0
    with Reader(folder / "bag") as bag:
        counts = {connection.topic: connection.msgcount for connection in bag.connections}
    assert counts["/target_pose"] == counts["/joint_command"] == 141
    assert counts["/tracking_error/position"] == counts["/tracking_error/orientation"] == 141


@pytest.mark.parametrize(
    ("signal_number", "code"), [(signal.SIGTERM, 128 + 15), (signal.SIGINT, 128 + 2)]
)
def test_an_interrupted_demo_leaves_no_process(
    tmp_path: Path, signal_number: int, code: int
) -> None:
    folder = tmp_path / "demo"
    command = (sys.executable, "-m", "examples.demo", "--out", str(folder))
    process = Process(*command, log=tmp_path / "demo.log")
    try:
        wait_until(
            lambda: not process.is_running or len(processes_mentioning(str(folder))) == 2,
            "the training of the demo",
        )
        process.signal(signal_number)
        assert process.wait_for_exit() == code
    finally:
        process.kill()
    assert "Traceback" not in process.log
    assert processes_mentioning(str(folder)) == []


def test_a_folder_with_other_files_is_not_emptied(tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    photo.write_text("dear")
    result = run_python("-m", "examples.demo", "--out", tmp_path)
    assert result.returncode == 1
    assert "not the folder of a demo" in result.stderr
    assert photo.read_text() == "dear"
