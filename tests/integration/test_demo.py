"""The demo as its user runs it: every process real, every file there, every figure good enough."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from annik_ros.processes import wait_until

ROOT = Path(__file__).parents[2]
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
    result = subprocess.run(
        [sys.executable, "-m", "examples.demo", "--out", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=240,
    )
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
    assert 0 < results["training"]["seconds"] < 30

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
    process = subprocess.Popen(
        [sys.executable, "-m", "examples.demo", "--out", str(folder)],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        assert wait_until((folder / "logs" / "train.log").exists, timeout=30.0)
        assert len(processes_mentioning(str(folder))) == 2
        process.send_signal(signal_number)
        _, errors = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == code
    assert b"Traceback" not in errors
    assert processes_mentioning(str(folder)) == []


def test_a_folder_with_other_files_is_not_emptied(tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    photo.write_text("dear")
    result = subprocess.run(
        [sys.executable, "-m", "examples.demo", "--out", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 1
    assert "not the folder of a demo" in result.stderr
    assert photo.read_text() == "dear"
