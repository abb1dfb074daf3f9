"""ik_node with a model that was learned from measured poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from support.learned_model import EXPECTED_ERROR, write_learned_model

from annik_core.robots.library import load_robot


def test_it_says_what_it_is_and_refuses_what_it_is_not_sure_of(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """The node's diagnostics name the measured poses and the expected error; the limit holds."""
    model = tmp_path / "learned.onnx"
    robot = write_learned_model(model)
    launch("ik_node", "-p", f"model:={model}", "-p", "queue_depth:=100")
    launch("fake_robot", "-p", f"model:={model}")
    edge = robot.joint_box.centre
    near = edge.copy()
    edge[0] = 0.99 * robot.joint_box.upper[0]
    close, far = robot.forward_kinematics.poses(np.array([near, edge]))
    client.connect(close, "tracking_error/position")
    error = client.received["tracking_error/position"][-1].vector
    assert np.linalg.norm([error.x, error.y, error.z]) < 1e-6
    _, values = client.wait_for_status(
        "ik_node", lambda values: values["expected error p50 [mm]"] != "", "an expected error"
    )
    assert values["forward kinematics"] == "learned from 102 measured poses"
    assert abs(float(values["expected error p50 [mm]"]) - 1e3 * EXPECTED_ERROR) < 1e-3
    assert client.set_parameter("ik_node", "max_expected_error", 2 * EXPECTED_ERROR).successful
    before = len(client.received["joint_command"])
    client.send(far)
    _, values = client.wait_for_status(
        "ik_node", lambda values: values["targets refused"] == "1", "a refusal"
    )
    assert values["refused: expected error too large"] == "1"
    assert "expected error 0.133" in values["last refusal"]
    assert len(client.received["joint_command"]) == before


def test_a_robot_that_was_learned_anew_is_the_same_robot(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """A learned model takes the place of the nominal one, and the other way round, by a reload."""
    model = tmp_path / "learned.onnx"
    robot = write_learned_model(model)
    launch("ik_node", "-p", "model:=ur5e", "-p", "queue_depth:=100")
    nominal = load_robot("ur5e")
    target = nominal.forward_kinematics.poses(nominal.joint_box.centre[np.newaxis])[0]
    client.connect(target)
    for path, expected in ((model, robot), ("ur5e", nominal)):
        assert client.set_parameter("ik_node", "model", str(path)).successful
        response = client.call("ik_node/reload_model")
        assert response.success, response.message
        target[0] += 1e-4
        client.send(target)
        client.wait_for_results(target, ["joint_command"])
        command = np.array([client.received["joint_command"][-1].position])
        reached = expected.forward_kinematics.poses(command)[0]
        assert np.linalg.norm(reached[:3] - target[:3]) < 1e-6
