"""Another model while the node serves: proven first, and never another robot's."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import onnx
import pytest
from support.processes import wait_until

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray, pose_from_roll_pitch_yaw


def _target(number: int) -> FloatArray:
    return pose_from_roll_pitch_yaw([0.3001 + 1e-3 * number, 0.4, 0.6], [0.5, 0.4, 0.3])


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A copy of the packaged model that a test may spoil."""
    return Path(shutil.copy(default_model_path(), tmp_path / "model.onnx"))


def test_a_model_can_be_loaded_again(launch: Callable[..., Any], client: Any, model: Path) -> None:
    """The response names the file, and targets are answered as before."""
    node = launch("ik_node", "-p", f"model:={model}")
    client.connect(_target(0))
    response = client.call("ik_node/reload_model")
    assert response.success
    assert response.message == f"now serving {model}, as described"
    client.send(_target(1))
    client.wait_for_results(_target(1), ["joint_command"])
    assert f"now serving {model}" in node.log


def test_another_file_is_served_once_its_path_is_set(
    launch: Callable[..., Any], client: Any, model: Path
) -> None:
    """Until the reload, diagnostics name the file that is served, not the one to come."""
    launch("ik_node")
    client.connect(_target(0))
    client.set_parameter("ik_node", "model", str(model))
    _, values = client.wait_for_status("ik_node", lambda _: True, "any state")
    assert values["model"] == str(default_model_path())
    assert client.call("ik_node/reload_model").success
    client.wait_for_status("ik_node", lambda values: values["model"] == str(model), "the new file")


@pytest.mark.parametrize("fault", ["missing", "truncated", "not ONNX"])
def test_the_old_model_serves_on_when_the_new_one_is_unusable(
    launch: Callable[..., Any], client: Any, model: Path, fault: str
) -> None:
    """The response says why."""
    node = launch("ik_node", "-p", f"model:={model}")
    client.connect(_target(0))
    content = model.read_bytes()
    if fault == "missing":
        model.unlink()
    else:
        model.write_bytes(content[: len(content) // 2] if fault == "truncated" else b"text")
    response = client.call("ik_node/reload_model")
    assert not response.success
    assert response.message.startswith(f"still serving {model}: model {model}: ")
    assert response.message in node.log
    client.send(_target(1))
    client.wait_for_results(_target(1), ["joint_command"])
    model.write_bytes(content)
    assert client.call("ik_node/reload_model").success


def test_the_model_of_another_robot_is_refused(
    launch: Callable[..., Any], client: Any, model: Path, other_robots_model: Path
) -> None:
    """It is a good file, but its commands would mean something else."""
    launch("ik_node", "-p", f"model:={model}")
    client.connect(_target(0))
    model.write_bytes(other_robots_model.read_bytes())
    response = client.call("ik_node/reload_model")
    assert not response.success
    assert "belongs to robot other" in response.message
    client.send(_target(1))
    client.wait_for_results(_target(1), ["joint_command"])


def test_commands_for_another_robot_are_refused_by_the_fake_robot(
    launch: Callable[..., Any], client: Any, other_robots_model: Path
) -> None:
    """The joints have other names, so nothing moves, and both are named."""
    launch("ik_node")
    robot = launch(
        "fake_robot", "-p", f"model:={other_robots_model}", "-p", "joint_state_rate:=0.0"
    )
    client.connect(_target(0))
    client.repeat_until(
        lambda: client.send(_target(0)),
        lambda: "joint state lacks other_x_drive_joint" in robot.log,
        "a refusal",
    )
    assert "it names x_drive_joint" in robot.log
    client.wait_for_status(
        "fake_robot", lambda values: int(values.get("refused: missing joint", 0)) > 0, "a refusal"
    )
    assert not client.received["joint_states"]


def test_limits_can_be_changed_while_the_node_serves(
    launch: Callable[..., Any], client: Any
) -> None:
    """A limit out of range is refused, one in range counts from the next target on."""
    node = launch("ik_node", "-p", "queue_depth:=100")
    client.connect(_target(0))
    assert not client.set_parameter("ik_node", "max_joint_step", -1.0).successful
    assert not client.set_parameter("ik_node", "queue_depth", 5).successful
    assert client.set_parameter("ik_node", "max_joint_step", 1e-3).successful
    client.send(_target(50))
    node.wait_for_text("joint step too large")
    assert client.set_parameter("ik_node", "max_joint_step", 1.0).successful
    client.send(_target(51))
    client.wait_for_results(_target(51), ["joint_command"])
    assert not client.stamps_of(_target(50))


def test_a_poor_model_is_said_at_start_at_a_reload_and_in_diagnostics(
    launch: Callable[..., Any], client: Any, model: Path
) -> None:
    """In one line; of a good one nothing is said."""
    good = model.read_bytes()
    poor = onnx.load_from_string(good)
    for entry in poor.metadata_props:
        if entry.key == "annik.evaluation":
            entry.value = json.dumps({"accepted": 0.4, "redundant_joints": ["lift"]})
    onnx.save(poor, model)
    node = launch("ik_node", "-p", f"model:={model}")
    (line,) = [line for line in node.log.splitlines() if f"model {model}: 40 % of" in line]
    assert "poor: " in line
    assert "redundant: lift" in line
    client.wait_for_status(
        "ik_node", lambda values: "poor: " in values["model quality"], "the quality"
    )
    model.write_bytes(good)
    assert client.call("ik_node/reload_model").success
    client.wait_for_status(
        "ik_node",
        lambda values: values["model quality"] == "100 % of random poses solved",
        "the quality of the good one",
    )
    onnx.save(poor, model)
    assert client.call("ik_node/reload_model").success
    # The response comes first.
    wait_until(lambda: node.log.count(f"model {model}: 40 % of") == 2, "the second warning")
