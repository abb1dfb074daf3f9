"""What tests of every part share."""

from __future__ import annotations

from pathlib import Path

import pytest
import support  # noqa: F401 - sets up the environment that rclpy reads when it is imported
from hypothesis import HealthCheck, settings

from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot

# A loaded machine is slow, not wrong; and the gantry is frozen, so that examples may share it.
settings.register_profile(
    "annik", deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
settings.load_profile("annik")


@pytest.fixture(scope="session")
def gantry() -> Robot:
    """The paper's robot."""
    return load_robot("gantry")


@pytest.fixture(scope="session")
def arm_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the arm of ``six_joint_arm``, as ``annik train`` makes one from its URDF.

    It is barely trained: what an answer is worth, refinement has to see to. Beside it are the
    URDF, ``arm.urdf``, and what the command wrote and printed: ``summary.json``, ``printed.txt``.
    """
    from click.testing import CliRunner
    from support.six_joint_arm import FRAMES, JOINT_BOX, URDF

    from annik_training.cli import cli

    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(URDF, encoding="utf-8")
    arguments = (
        *("train", "--robot", folder / "arm.urdf", *FRAMES, *JOINT_BOX),
        *("--examples", 64, "--hidden", "8", "--max-evaluations", 5, "--seed", 3),
        *("--evaluation-poses", 200),
        *("--out", folder / "arm.onnx", "--summary", folder / "summary.json"),
    )
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    (folder / "printed.txt").write_text(result.output, encoding="utf-8")
    return folder / "arm.onnx"
