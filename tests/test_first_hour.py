"""The commands of docs/first_hour.md run in the order in which they stand."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest
from support.processes import LONG_PATIENCE, ROOT

from examples.demonstration import reserved_domain

STAMP = ROOT / ".venv" / "annik-setup"


@pytest.mark.process
@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.skipif(not STAMP.is_file(), reason="the checkout is not set up by ./run")
def test_the_commands_run_in_their_order(tmp_path: Path) -> None:
    for name in ("run", ".venv"):
        (tmp_path / name).symlink_to(ROOT / name)
    page = (ROOT / "docs" / "first_hour.md").read_text(encoding="utf-8")
    # Whatever fails, its nodes end.
    commands = "trap 'kill $(jobs -p) || true' EXIT\n" + "".join(
        re.findall(r"^```bash\n(.*?)^```$", page, flags=re.M | re.S)
    )
    with reserved_domain() as domain:
        result = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", commands],
            cwd=tmp_path,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LONG_PATIENCE,
            check=False,
        )
    assert result.returncode == 0, result.stderr
    written = {path.name for path in (tmp_path / "my_first_hour").iterdir()}
    assert {"gantry.onnx", "my_arm.onnx", "poses.csv", "my_calibrated_arm.urdf"} <= written
    assert "102 examples" in result.stdout
    assert "published 15 targets" in result.stdout + result.stderr
    assert "x is 9 m" in result.stdout  # the pose that is out of reach
