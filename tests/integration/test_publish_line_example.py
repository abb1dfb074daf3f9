"""The example that needs ROS runs as it stands."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]


def test_publish_line(launch: Callable[..., Any], domain: int) -> None:
    for module in ("ik_node", "fake_robot"):
        launch(module)
    result = subprocess.run(
        [sys.executable, "examples/publish_line.py"],
        cwd=ROOT,
        env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 0, result.stderr
    missed = [line for line in result.stdout.splitlines() if line.startswith("missed by 0.0")]
    # The last target's error may come when the script has ended.
    assert len(missed) > 30, result.stdout
