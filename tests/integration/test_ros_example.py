"""The example that needs ROS runs as it stands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from support.processes import run_python


def test_publish_line(launch: Callable[..., Any], domain: int) -> None:
    for module in ("ik_node", "fake_robot"):
        launch(module)
    result = run_python(
        "examples/06_publish_a_line.py", environment={"ROS_DOMAIN_ID": str(domain)}
    )
    assert result.returncode == 0, result.stderr
    missed = [line for line in result.stdout.splitlines() if line.startswith("missed by 0.0")]
    # The last target's error may come when the script has ended.
    assert len(missed) > 30, result.stdout
