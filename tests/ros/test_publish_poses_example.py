"""The examples that need ROS run as they stand."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


def test_publish_poses(launch: Callable[..., Any], domain: int) -> None:
    for module in ("ik_node", "fake_robot_node"):
        launch(module)
    result = subprocess.run(
        [sys.executable, "examples/publish_poses.py"],
        cwd=ROOT,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 0, result.stderr
    assert "target 9: missed by 0.0" in result.stdout
