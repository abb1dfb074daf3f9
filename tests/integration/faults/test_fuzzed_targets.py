"""Tens of thousands of messages that are none, or mean nothing, on every topic that is read."""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from invariants import (
    LARGEST_ERROR,
    assert_all_numbers_finite,
    assert_every_command_belongs_to_a_target,
    counts_in,
    gantry_robot,
    good_target,
    listen_to_all_commands,
    settled,
    wait_for_counts,
)
from mutations import message_of, mutated
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray, checked_pose
from annik_core.serving.ik_server import IkServer
from annik_core.solver.ik_solver import IkSolver
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import pose_to_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds

FUZZED = 10_000
WILD = 3000
BATCH = 2000
#: A plain Pose can't be longer: the publisher's own middleware refuses to send it.
LONGEST = {Pose: 60, PoseStamped: 5000, PoseArray: 5000}
SOLVER = IkSolver.from_file(default_model_path())
TOPICS = {Pose: "target_pose", PoseStamped: "target_pose_stamped", PoseArray: "target_poses"}


@pytest.mark.parametrize(
    ("message_type", "executor"),
    [(Pose, "events"), (PoseStamped, "single_threaded"), (PoseArray, "events")],
)
def test_fuzzed_targets_are_counted_one_by_one_and_good_ones_between_them_answered(
    launch: Callable[..., Any], client: Any, message_type: type, executor: str
) -> None:
    """And nothing is commanded whose position was not sent, byte for byte."""
    node = launch("ik_node", "-p", "queue_depth:=100000", "-p", f"executor:={executor}")
    listen_to_all_commands(client)
    publisher = client.node.create_publisher(
        message_type, TOPICS[message_type], QoSProfile(depth=100_000)
    )
    result = "joint_trajectory" if message_type is PoseArray else "joint_command"

    def results() -> int:
        return len(client.received[result])

    sent = []
    numbers = itertools.count(50_000)
    newest = good_target(next(numbers))

    def send_another() -> None:
        newest[:] = good_target(next(numbers))
        sent.append(serialize_message(message_of(message_type, [newest])))
        publisher.publish(sent[-1])

    # What was sent before the newest one has come before it, or never will.
    client.repeat_until(
        send_another, lambda: _is_answered(client, message_type, newest), "an answer", pause=1.0
    )
    contacts = settled(client)
    fuzzed = mutated(message_type, good_target(0), FUZZED, 1, LONGEST[message_type])
    for batch in range(FUZZED // BATCH):
        for _ in range(BATCH):
            sent.append(next(fuzzed))
            publisher.publish(sent[-1])
        good = good_target(batch + 1)
        sent.append(serialize_message(message_of(message_type, [good], "base_link")))
        publisher.publish(sent[-1])
        client.wait_until(
            lambda good=good: _is_answered(client, message_type, good), "a good one's answer"
        )
    counts = wait_for_counts(client, contacts + FUZZED + FUZZED // BATCH)
    assert counts.reasons["malformed message"] > FUZZED / 4
    client.wait_until(lambda: results() == counts.accepted - contacts, "all results")
    assert_all_numbers_finite(client)
    if message_type is not PoseArray:
        poses = [checked_pose(pose_to_array(m.pose)) for m in client.received["accepted_target"]]
        bytes_sent = b"".join(sent)
        for x, y, z, *_ in poses:
            position = struct.pack("<3d", x, y, z), struct.pack(">3d", x, y, z)
            assert position[0] in bytes_sent or position[1] in bytes_sent
        assert_every_command_belongs_to_a_target(client, poses)
    assert "Traceback" not in node.log


def _is_answered(client: Any, message_type: type, good: FloatArray) -> bool:
    """Whether the newest result is this target's; its x tells it from the others."""
    if message_type is not PoseArray:
        accepted = client.received["accepted_target"]
        return bool(accepted) and accepted[-1].pose.position.x == good[0]
    trajectories = client.received["joint_trajectory"]
    expected = SOLVER.solve(good).joint_positions
    return bool(trajectories) and np.allclose(
        trajectories[-1].points[-1].positions, expected, rtol=0, atol=1e-8
    )


def _wild_poses(robot_poses: FloatArray, count: int, seed: int) -> FloatArray:
    """Reachable poses, each with numbers replaced by wild ones or moved a little."""
    random = np.random.default_rng(seed)
    poses = robot_poses[random.integers(len(robot_poses), size=count)]
    wild = [math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 0.0, -0.0, 1e-160, 1e160, 1.0]
    replaced = random.random(poses.shape) < 0.15
    poses[replaced] = random.choice(wild, replaced.sum())
    moved = random.random(poses.shape) < 0.15
    poses[moved] *= 1.0 + random.normal(0, 1e-3, moved.sum())
    return poses


@pytest.mark.parametrize("model", ["gantry", "ur5e", "scara"])
def test_no_seven_numbers_make_the_server_raise_or_command_what_is_not_finite(model: str) -> None:
    """Thousands of them, near the reachable and far from it; and it still answers a good one."""
    solver = IkSolver.from_file(default_model_path().with_name(f"{model}.onnx"))
    server = IkServer(solver)
    box = solver.robot.joint_box
    share = np.random.default_rng(0).uniform(0.3, 0.7, (50, solver.robot.dof))
    reachable = solver.robot.forward_kinematics.poses(box.lower + share * (box.upper - box.lower))
    accepted = 0
    with np.errstate(all="ignore"):
        for pose in _wild_poses(reachable, WILD, 2):
            result = server.solve(pose)
            if result.accepted:
                accepted += 1
                reached = solver.robot.forward_kinematics.poses(result.joint_positions[None])[0]
                assert np.linalg.norm(reached[:3] - pose[:3]) < LARGEST_ERROR
    assert accepted > 30
    outcomes = server.end_period().outcomes
    assert outcomes.received == WILD == outcomes.accepted + outcomes.refused
    assert "solver failed" not in outcomes.refused_by_reason
    assert any(server.solve(pose).accepted for pose in reachable)


def _fuzzed_joint_states(count: int) -> list[bytes]:
    """Joint states that went wrong; most can't be read at all."""
    random = np.random.default_rng(3)
    robot = gantry_robot()
    # Some of these stay sound, so they must be far from where the targets lead.
    corner = robot.joint_box.lower
    fuzzed = []
    for index in range(count):
        positions = corner.copy()
        if index % 4 == 0:
            positions[int(random.integers(robot.dof))] = math.nan
        data = bytearray(
            serialize_message(
                joint_state_from_array(positions, robot.joint_names, stamp_from_nanoseconds(index))
            )
        )
        if index % 4 == 1:
            del data[int(random.integers(4, len(data) - 60)) :]
        elif index % 4 == 2:
            data = data[:4] + random.bytes(int(random.integers(300)))
        elif index % 4 == 3:
            # In the names, their lengths, and what is between them.
            data[int(random.integers(20, 150))] ^= int(random.integers(1, 256))
        fuzzed.append(bytes(data))
    return fuzzed


def test_fuzzed_joint_states_and_commands_move_nothing(
    launch: Callable[..., Any], client: Any
) -> None:
    """The ik_node takes none of them for where the robot is, and the fake robot follows none."""
    node = launch("ik_node", "-p", "first_command:=near", "-p", "queue_depth:=1000", ready=False)
    robot_node = launch("fake_robot", "-r", "joint_states:=robot_states", ready=False)
    client.listen("robot_states", JointState)
    states = client.node.create_publisher(
        JointState,
        "joint_states",
        QoSProfile(depth=100_000, reliability=ReliabilityPolicy.BEST_EFFORT),
    )
    commands = client.node.create_publisher(JointState, "joint_command", QoSProfile(depth=100_000))
    # The client itself listens to the commands too, and to no states of the least effort.
    client.wait_until(lambda: states.get_subscription_count() == 1, "the ik_node")
    client.wait_until(lambda: commands.get_subscription_count() == 2, "the fake robot")
    names, middle = gantry_robot().joint_names, gantry_robot().joint_box.centre
    for index, data in enumerate(_fuzzed_joint_states(2000)):
        states.publish(data)
        commands.publish(data)
        if index % 50 == 0:
            client.send(good_target(index))
            client.take_messages(0.01)
    counts = wait_for_counts(client, 40)
    assert counts.reasons == {"first command too far": 40}
    assert not client.received["accepted_target"]
    for process in (node, robot_node):
        assert process.is_running
        assert "Traceback" not in process.log
    # The mark of what the fake robot followed is a state under the command's stamp.
    commands.publish(joint_state_from_array(middle, names, stamp_from_nanoseconds(123_456)))
    client.wait_until(lambda: client.stamps("robot_states")[-1:] == [123_456], "a state")
    for message in client.received["robot_states"]:
        assert tuple(message.name) == names
        assert np.isfinite(message.position).all()
    _, values = client.wait_for_status("fake_robot", lambda _: True, "any state")
    counts_in(values, "commands")


def test_a_pose_message_means_the_same_however_it_is_read() -> None:
    """The seven numbers of the raw bytes are those of the message that the middleware makes."""
    pose = good_target(1)
    message = deserialize_message(serialize_message(message_of(Pose, [pose])), Pose)
    np.testing.assert_array_equal(pose_to_array(message), pose)
