"""Each example runs as it stands. ROS-free; the one with ROS is in tests/integration."""

from __future__ import annotations

import numpy as np
import pytest
from support.processes import run_python


@pytest.mark.process
def test_use_model_without_ros() -> None:
    """Its answer is that of the paper's equations (3)-(4)."""
    result = run_python("examples/use_model_without_ros.py")
    assert result.returncode == 0, result.stderr
    lines = dict(line.split(": ") for line in result.stdout.splitlines())
    degrees = [np.degrees(float(value.removesuffix(" rad"))) for value in lines.values()]
    yaw = np.degrees(0.5)
    assert degrees == pytest.approx([35, 35, 35, 20, 20, (yaw + 60) / 3], abs=1e-3)
    assert next(iter(lines)) == "x_drive_joint"
