"""An arm over DDS: every answer inside the working box and exact, or refused with its reason."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import JointState
from support.six_joint_arm import BASE, FLANGE, URDF

from annik_core.kernel import NO_KERNEL
from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import vector3_to_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds

ERRORS = ("tracking_error/position", "tracking_error/orientation")


@pytest.fixture(scope="module")
def robot(arm_model: Path) -> Robot:
    return load_model(arm_model).robot


def _targets(robot: Robot, count: int, seed: int = 0) -> FloatArray:
    """Random poses from the middle of the working box."""
    box = robot.joint_box
    share = np.random.default_rng(seed).uniform(0.2, 0.8, (count, robot.dof))
    return robot.forward_kinematics.poses(box.lower + share * (box.upper - box.lower))


def _pose(robot: Robot, joint_positions: FloatArray) -> FloatArray:
    return robot.forward_kinematics.poses(np.array([joint_positions]))[0]


def _described(folder: Path, **frames: str) -> tuple[str, ...]:
    """The arguments that give a node the URDF of the arm, as a launch file does."""
    parameters = {"robot_description": URDF, **frames}
    path = folder / "parameters.yaml"
    # JSON is YAML too.
    path.write_text(json.dumps({"/**": {"ros__parameters": parameters}}), encoding="utf-8")
    return "--params-file", str(path)


def test_an_arm_follows_its_targets_exactly_and_inside_the_working_box(
    launch: Callable[..., Any],
    client: Any,
    robot: Robot,
    arm_model: Path,
    tmp_path: Path,
) -> None:
    """Also a fake robot that knows the arm by its robot_description, as other nodes of ROS do."""
    described = _described(tmp_path, base_frame=BASE, end_effector_frame=FLANGE)
    # Both listen to one ik_node, and each publishes in a namespace of its own.
    same_topics = [
        argument
        for topic in ("joint_command", "accepted_target")
        for argument in ("-r", f"{topic}:=/{topic}")
    ]
    launch("ik_node", "-p", f"model:={arm_model}", "-p", "queue_depth:=100", ready=False)
    for namespace, known_by in (
        ("by_model", ("-p", f"model:={arm_model}")),
        ("by_description", described),
    ):
        launch("fake_robot", *known_by, "-r", f"__ns:=/{namespace}", *same_topics, ready=False)
    topics = [f"{name}/{topic}" for name in ("by_model", "by_description") for topic in ERRORS]
    for topic in topics:
        client.listen(topic, Vector3Stamped)
    client.listen("by_description/joint_states", JointState)
    contact, *targets = _targets(robot, 13)
    for topic in topics:
        client.connect(contact, topic)
    for target in targets:
        client.send(target)
    client.wait_for_results(targets[-1], ["joint_command", "by_description/joint_states", *topics])
    commands = dict(
        zip(client.stamps("joint_command"), client.received["joint_command"], strict=True)
    )
    for target in targets:
        (stamp,) = client.stamps_of(target)
        assert tuple(commands[stamp].name) == robot.joint_names
        assert robot.joint_box.violation(np.array(commands[stamp].position)) is None
        for topic in topics:
            by_stamp = dict(zip(client.stamps(topic), client.received[topic], strict=True))
            assert by_stamp[stamp].header.frame_id == BASE
            assert np.linalg.norm(vector3_to_array(by_stamp[stamp].vector)) < 1e-5
    # A namespace is of topics; joints and frames keep their names.
    for message in client.received["by_description/joint_states"]:
        assert tuple(message.name) == robot.joint_names
    _, values = client.wait_for_status("ik_node", lambda _: True, "any state")
    assert (values["robot"], values["mode"]) == ("bench_arm", "refined")


def test_what_an_arm_can_not_reach_is_refused_with_its_reason(
    launch: Callable[..., Any], client: Any, robot: Robot, arm_model: Path
) -> None:
    """Too far away, and within reach but only by joints outside the working box."""
    node = launch("ik_node", "-p", f"model:={arm_model}", "-p", "queue_depth:=100")
    good, next_good = _targets(robot, 2)
    client.connect(good)
    before = len(client.received["joint_command"])
    too_far = good + np.array([9.0, 0, 0, 0, 0, 0, 0])
    turned_away = _pose(robot, [2.6, -0.8, 1.0, 0.0, 1.0, 0.0])
    for target in (too_far, turned_away):
        client.send(target)
    client.send(next_good)
    client.wait_for_results(next_good, ["joint_command"])
    assert len(client.received["joint_command"]) == before + 1
    assert not client.stamps_of(too_far)
    assert not client.stamps_of(turned_away)
    _, values = client.wait_for_status(
        "ik_node", lambda values: values["targets refused"] == "2", "both refusals"
    )
    assert (values["refused: outside workspace"], values["refused: not converged"]) == ("1", "1")
    assert "no solution in the joint box was found" in values["last refusal"]
    assert "the arm reaches at most" in node.log


def test_how_an_arm_is_answered_can_be_changed_while_the_node_serves(
    launch: Callable[..., Any], client: Any, robot: Robot, arm_model: Path
) -> None:
    """From the next target on; a value that makes no sense is refused, and the node lives on."""
    node = launch("ik_node", "-p", f"model:={arm_model}", "-p", "queue_depth:=100")
    targets = iter(_targets(robot, 9))
    client.connect(next(targets))

    def change(name: str, value: object) -> Any:
        return client.set_parameter("ik_node", name, value)

    def answered() -> None:
        target = next(targets)
        client.send(target)
        client.wait_for_results(target, ["joint_command"])

    def refused(reason: str, count: str) -> dict[str, str]:
        target = next(targets)
        client.send(target)
        _, values = client.wait_for_status(
            "ik_node", lambda values: values.get(f"refused: {reason}") == count, reason
        )
        assert not client.stamps_of(target)
        return values

    assert change("mode", "network").successful
    assert refused("residual too large", "1")["mode"] == "network"
    assert change("mode", "refined").successful
    answered()
    assert change("max_newton_steps", 0).successful
    assert "are left after 0 steps" in refused("not converged", "1")["last refusal"]
    assert change("max_newton_steps", 10).successful
    for name, value in (
        ("mode", 3),
        ("max_newton_steps", -1),
        ("refinement_tolerance", math.nan),
        ("max_position_residual", math.nan),
    ):
        assert not change(name, value).successful
    choice = change("mode", "guess")
    assert not choice.successful
    assert choice.reason == (
        "mode is 'guess'; allowed: one of auto, network, refined, whole_robot"
    )
    answered()
    assert "Traceback" not in node.log


def test_a_fake_robot_stands_in_for_a_packaged_arm(
    launch: Callable[..., Any], client: Any
) -> None:
    """By its name alone; commands beyond the joint limits are refused."""
    ur5e = load_robot("ur5e")
    middle = ur5e.joint_box.centre
    pose = _pose(ur5e, middle)
    launch("fake_robot", "-p", "robot:=ur5e", "-p", "joint_state_rate:=0.0", ready=False)

    def publish_two_pairs() -> None:
        for stamp, positions in ((1, middle + 9.0), (2, middle)):
            client.accepted_target.publish(client.pose_stamped(pose, stamp, ur5e.base_frame))
            client.command.publish(
                joint_state_from_array(positions, ur5e.joint_names, stamp_from_nanoseconds(stamp))
            )

    client.repeat_until(
        publish_two_pairs,
        lambda: all(client.received[topic] for topic in ("joint_states", *ERRORS)),
        "the errors of a good pair",
    )
    assert set(client.stamps("joint_states")) == set(client.stamps(ERRORS[0])) == {2}
    for topic in ERRORS:
        for message in client.received[topic]:
            assert np.linalg.norm(vector3_to_array(message.vector)) < 1e-12
    client.wait_for_status(
        "fake_robot", lambda values: int(values.get("refused: joint limit", 0)) > 0, "a refusal"
    )


def test_a_robot_description_without_the_frames_that_it_needs_ends_the_fake_robot(
    launch: Callable[..., Any], tmp_path: Path
) -> None:
    """One line that says which to give, exit code 1."""
    node = launch("fake_robot", *_described(tmp_path), ready=False)
    assert node.wait_for_exit() == 1
    (fatal,) = [line for line in node.log.splitlines() if "[FATAL]" in line]
    assert "give end_effector_frame, one of its links, such as left_finger" in fatal
    assert "Traceback" not in node.log


def test_both_nodes_know_packaged_models_by_their_names(launch: Callable[..., Any]) -> None:
    nodes = [
        launch(module, "-p", "model:=gantry", ready=False) for module in ("ik_node", "fake_robot")
    ]
    nodes[0].wait_for_text("models/gantry.onnx for robot gantry")
    nodes[1].wait_for_text("fake robot gantry")


@pytest.mark.parametrize(("model", "said"), [("ur5e", True), ("gantry", False)])
def test_an_arm_that_is_served_without_the_compiled_kernel_is_said(
    launch: Callable[..., Any], model: str, said: bool
) -> None:
    node = launch("ik_node", "-p", f"model:={model}", environment={"ANNIK_KERNEL": "off"})
    node.signal(signal.SIGINT)
    assert node.wait_for_exit() == 0
    assert node.log.count(": ".join(NO_KERNEL)) == said
