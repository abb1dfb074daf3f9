"""Each example runs as it stands. ROS-free; the one with ROS is in tests/ros."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_solve_without_ros() -> None:
    result = subprocess.run(
        [sys.executable, "examples/solve_without_ros.py"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 0, result.stderr
    assert "x_drive_joint: 0." in result.stdout
    assert "refused: z is 1.65 m, the workspace is [0.5, 0.8] m" in result.stdout
