"""Each numbered example runs as it stands. ROS-free; the one with ROS is in tests/integration."""

from __future__ import annotations

import re

import numpy as np
import pytest
from support.processes import LONG_PATIENCE, ROOT, run_python

WITH_ROS = "06_publish_a_line"


def printed(example: str) -> str:
    """What an example prints."""
    result = run_python(f"examples/{example}.py", patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stderr
    return result.stdout


def number(pattern: str, text: str) -> float:
    """The number that a pattern captures."""
    found = re.search(pattern, text)
    assert found is not None, text
    return float(found[1])


def test_there_are_six_short_ones_and_each_is_run() -> None:
    examples = sorted((ROOT / "examples").glob("[0-9]*.py"))
    assert [path.name[:2] for path in examples] == ["01", "02", "03", "04", "05", "06"]
    here = (ROOT / "tests" / "test_examples.py").read_text(encoding="utf-8")
    for path in examples:
        assert f'"{path.stem}"' in here
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 55


@pytest.mark.process
def test_solve_a_pose() -> None:
    text = printed("01_solve_a_pose")
    assert text.count(" rad\n") == 7
    assert number(r"off by (\d+) nm", text) <= 500
    assert "outside workspace: the target is" in text
    assert "200 of 200 random poses solved" in text


@pytest.mark.process
def test_train_the_gantry() -> None:
    text = printed("02_train_the_gantry")
    assert "179 examples" in text
    assert number(r"([\d.]+) mm at 95 of 100 poses", text) < 0.1
    degrees = [float(value) for value in re.findall(r"[\d.]+", text.splitlines()[3])]
    yaw = np.degrees(0.5)
    assert degrees == pytest.approx([35, 35, 35, 20, 20, (yaw + 60) / 3], abs=0.02)


@pytest.mark.process
def test_train_an_arm_from_a_urdf() -> None:
    text = printed("03_train_an_arm_from_urdf")
    assert "xarm6: joint1, joint2" in text
    assert number(r"refined: ([\d.]+) % solved", text) > 98.0
    assert "centre of the box: success" in text


@pytest.mark.process
def test_calibrate_a_robot() -> None:
    text = printed("04_calibrate_a_robot")
    assert "geometry, joint series" in text
    assert number(r"\nnominal: ([\d.]+) mm", text) > 1.0
    assert number(r"\ncalibrated: ([\d.]+) mm", text) < 0.06


@pytest.mark.process
def test_use_a_model_without_annik() -> None:
    """Its joint positions are those of the paper's equations (3)-(4)."""
    lines = dict(line.split(": ") for line in printed("05_model_without_annik").splitlines())
    degrees = [np.degrees(float(value.removesuffix(" rad"))) for value in lines.values()]
    yaw = np.degrees(0.5)
    assert degrees == pytest.approx([35, 35, 35, 20, 20, (yaw + 60) / 3], abs=1e-3)
    assert next(iter(lines)) == "x_drive_joint"
