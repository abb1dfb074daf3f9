"""What tests of every part share."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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


INTEGRATION = Path(__file__).parent / "integration"
#: What a test that is marked with one of these is not: quick.
NOT_QUICK = ("process", "ros", "colcon", "slow")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the quick tests. They are those that colcon runs, unless it is told otherwise."""
    integration = {path for path in {item.path for item in items} if INTEGRATION in path.parents}
    for item in items:
        if item.path in integration:
            item.add_marker("ros")
            item.add_marker("process")
        if not any(item.get_closest_marker(name) for name in NOT_QUICK):
            item.add_marker("quick")
    # Files that take long come first, so that no worker is left alone with one at the end. Then
    # those that mostly wait, for ROS, in turns with those that compute.
    long = {item.path for item in items if item.get_closest_marker("slow")}
    others = [path for path in dict.fromkeys(item.path for item in items) if path not in long]
    place = dict.fromkeys(long, 0.0)
    for waits, end in ((True, 0.8), (False, 1.0)):
        group = [path for path in others if (path in integration) is waits]
        place.update((path, end * number / len(group)) for number, path in enumerate(group, 1))
    items.sort(key=lambda item: place[item.path])
    # colcon sets it in the environment of what it starts.
    if "COLCON" in os.environ and not config.option.markexpr:
        config.option.markexpr = "quick"


@pytest.fixture(autouse=True)
def _quick_tests_start_no_process(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    started = []
    start = subprocess.Popen.__init__

    def watched(process: Any, command: Any, *arguments: Any, **options: Any) -> None:
        # To ask git for something takes no time.
        if command[0] != "git":
            started.append(command)
        start(process, command, *arguments, **options)

    monkeypatch.setattr(subprocess.Popen, "__init__", watched)
    yield
    if started and request.node.get_closest_marker("quick"):
        pytest.fail("it starts a process: mark it with pytest.mark.process")


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
    from support.six_joint_arm import JOINT_BOX, URDF

    return _trained(tmp_path_factory.mktemp("arm"), URDF, JOINT_BOX)


@pytest.fixture(scope="session")
def continuous_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the arm of ``continuous_arm``, made in the same way."""
    from support.continuous_arm import CONTINUOUS_URDF
    from support.six_joint_arm import JOINT_BOX

    # Without the box of the first joint.
    return _trained(tmp_path_factory.mktemp("continuous"), CONTINUOUS_URDF, JOINT_BOX[2:])


def _trained(folder: Path, urdf: str, joint_box: tuple[str, ...]) -> Path:
    from click.testing import CliRunner
    from support.six_joint_arm import FRAMES

    from annik_training.cli import cli

    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    arguments = (
        *("train", "--robot", folder / "arm.urdf", *FRAMES, *joint_box),
        *("--examples", 64, "--hidden", "8", "--max-evaluations", 5, "--seed", 3),
        *("--evaluation-poses", 200),
        *("--out", folder / "arm.onnx", "--summary", folder / "summary.json"),
    )
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    (folder / "printed.txt").write_text(result.output, encoding="utf-8")
    return folder / "arm.onnx"
