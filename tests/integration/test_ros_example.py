"""The example that needs ROS runs as it stands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from support.processes import run_python


def publish_a_line(domain: int, *arguments: str) -> Any:
    environment = {"ROS_DOMAIN_ID": str(domain)}
    return run_python("examples/06_publish_a_line.py", *arguments, environment=environment)


@pytest.mark.parametrize("model", ["gantry", "ur5e"])
def test_publish_line(launch: Callable[..., Any], domain: int, model: str) -> None:
    for module in ("ik_node", "fake_robot"):
        launch(module, "-p", f"model:={model}")
    result = publish_a_line(domain, *([] if model == "gantry" else [model]))
    assert result.returncode == 0, result.stderr
    missed = [line for line in result.stdout.splitlines() if line.startswith("missed by 0.0")]
    assert len(missed) >= 51, result.stdout


def test_a_refused_target_ends_it_with_the_reason(launch: Callable[..., Any], domain: int) -> None:
    for module in ("ik_node", "fake_robot"):
        launch(module, "-p", "model:=ur5e")
    result = publish_a_line(domain)
    assert result.returncode == 1
    assert "target 1 of 51 was refused" in result.stderr
    assert "'ik_node': " in result.stderr and "Traceback" not in result.stderr
