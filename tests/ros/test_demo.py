"""The demo as its user runs it: every process real, every file there, every figure good enough."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

ROOT = Path(__file__).parents[2]


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
        [sys.executable, "-m", "annik_ros.demo", "--out", str(folder)],
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
    assert results["training"]["seconds"] > 0

    for name in ("model.onnx", "report.html", "errors.png", "path.png", "bag/metadata.yaml"):
        assert (folder / name).stat().st_size > 0
    with Reader(folder / "bag") as bag:
        counts = {connection.topic: connection.msgcount for connection in bag.connections}
    assert counts["/target_pose"] == counts["/joint_command"] == 141
    assert counts["/tracking_error/position"] == counts["/tracking_error/orientation"] == 141
