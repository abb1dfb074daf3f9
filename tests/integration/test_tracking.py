"""The main job over DDS: targets in, commands out, the error of each measured."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from support.processes import EXIT_PATIENCE

from annik_core.pose import pose_from_roll_pitch_yaw
from annik_core.target_paths import diagonal_path
from msg_tools.conversions.pose import pose_to_array, vector3_to_array

RESULTS = (
    "joint_command",
    "joint_states",
    "achieved_pose",
    "tracking_error/position",
    "tracking_error/orientation",
)
#: Sent until everybody has met; no target of a test has this x.
CONTACT = pose_from_roll_pitch_yaw([0.3001, 0.4, 0.6], [0.5, 0.4, 0.3])


def test_every_target_is_answered_once_and_its_results_pair_by_stamp(
    launch: Callable[..., Any], client: Any
) -> None:
    """Each of 200 targets, sent in a burst, gives one message on every topic with one stamp."""
    launch("ik_node", "-p", "queue_depth:=1000")
    launch("fake_robot")
    client.connect(CONTACT, "tracking_error/orientation")
    targets = diagonal_path(200)
    for target in targets:
        client.send(target)
    client.wait_for_results(targets[-1], RESULTS)
    stamps = [client.stamps_of(target) for target in targets]
    assert [len(found) for found in stamps] == [1] * len(targets)
    ordered = [found[0] for found in stamps]
    assert ordered == sorted(set(ordered))
    for topic in RESULTS:
        found = client.stamps(topic)
        assert [stamp for stamp in found if stamp in set(ordered)] == ordered, topic
        assert len(found) == len(set(found)), topic


def test_the_tracking_error_is_target_minus_achieved_and_small(
    launch: Callable[..., Any], client: Any
) -> None:
    """In the base frame, and within the paper's best claim along the diagonal."""
    launch("ik_node", "-p", "queue_depth:=100")
    launch("fake_robot")
    client.connect(CONTACT, "tracking_error/orientation")
    targets = diagonal_path()
    for target in targets:
        client.send(target)
    client.wait_for_results(targets[-1], RESULTS)
    by_stamp = {
        topic: dict(zip(client.stamps(topic), client.received[topic], strict=True))
        for topic in (*RESULTS, "accepted_target")
    }
    for target in targets:
        (stamp,) = client.stamps_of(target)
        accepted = by_stamp["accepted_target"][stamp]
        achieved = by_stamp["achieved_pose"][stamp]
        error = by_stamp["tracking_error/position"][stamp]
        turn = by_stamp["tracking_error/orientation"][stamp]
        for message in (accepted, achieved, error, turn):
            assert message.header.frame_id == "base_link"
        np.testing.assert_array_equal(pose_to_array(accepted.pose), target)
        missing = target[:3] - pose_to_array(achieved.pose)[:3]
        np.testing.assert_array_equal(vector3_to_array(error.vector), missing)
        assert np.linalg.norm(missing) < 0.25e-3
        assert np.linalg.norm(vector3_to_array(turn.vector)) < np.radians(0.1)
        command, state = by_stamp["joint_command"][stamp], by_stamp["joint_states"][stamp]
        assert command.name == state.name
        assert list(command.position) == list(state.position)
        assert len(command.velocity) == len(command.effort) == 0


def test_the_orientation_error_is_the_rotation_from_achieved_to_target(
    launch: Callable[..., Any], client: Any
) -> None:
    """As a rotation vector in the base frame, of the two poses that are published too."""
    launch("ik_node", "-p", "queue_depth:=100")
    launch("fake_robot")
    client.connect(CONTACT, "tracking_error/orientation")
    targets = diagonal_path()
    for target in targets:
        client.send(target)
    client.wait_for_results(targets[-1], ("achieved_pose", "tracking_error/orientation"))
    by_stamp = {
        topic: dict(zip(client.stamps(topic), client.received[topic], strict=True))
        for topic in ("accepted_target", "achieved_pose", "tracking_error/orientation")
    }
    for target in targets:
        (stamp,) = client.stamps_of(target)
        wanted, achieved = (
            Rotation.from_quat(pose_to_array(by_stamp[topic][stamp].pose)[3:])
            for topic in ("accepted_target", "achieved_pose")
        )
        turn = vector3_to_array(by_stamp["tracking_error/orientation"][stamp].vector)
        assert np.linalg.norm(turn) > 0
        np.testing.assert_allclose(turn, (wanted * achieved.inv()).as_rotvec(), rtol=0, atol=1e-12)
        turned = Rotation.from_rotvec(turn) * achieved
        assert (turned * wanted.inv()).magnitude() < 1e-12


def test_a_stamp_is_the_time_at_which_its_target_was_accepted(
    launch: Callable[..., Any], client: Any
) -> None:
    """After the target was sent and before the command came, by the clock on the wall."""
    launch("ik_node")
    client.connect(CONTACT)
    for target in diagonal_path(10):
        before = time.time_ns()
        client.send(target)
        client.wait_for_results(target, ["joint_command"])
        after = time.time_ns()
        (stamp,) = client.stamps_of(target)
        assert before <= stamp <= after
        assert stamp in client.stamps("joint_command")


def test_a_burst_is_answered_by_its_newest_target_at_depth_one(
    launch: Callable[..., Any], client: Any
) -> None:
    """By default a late controller gets the newest target; the last one sent is never lost."""
    node = launch("ik_node")
    client.connect(CONTACT)
    targets = diagonal_path(500)
    node.signal(signal.SIGSTOP)
    for target in targets:
        client.send(target)
    node.signal(signal.SIGCONT)
    client.wait_until(lambda: client.stamps_of(targets[-1]), "the last target's answer")
    answered = [target for target in targets if client.stamps_of(target)]
    assert len(answered) < len(targets)
    assert max(len(client.stamps_of(target)) for target in targets) == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nodes_end_with_exit_code_0_when_asked_to(
    launch: Callable[..., Any], client: Any, number: signal.Signals
) -> None:
    """Soon, in the middle of work, and without a traceback."""
    nodes = [launch(node, own_interpreter=True) for node in ("ik_node", "fake_robot")]
    arguments = ("-p", "loops:=0", "-p", "rate:=500")
    nodes.append(launch("target_publisher", *arguments, own_interpreter=True))
    client.wait_until(lambda: len(client.received["joint_command"]) > 100, "the robot moves")
    for node in reversed(nodes):
        node.signal(number)
    assert [node.wait_for_exit(EXIT_PATIENCE) for node in nodes] == [0, 0, 0]
    assert not any("Traceback" in node.log for node in nodes)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_publisher_that_waits_ends_when_asked_to(
    launch: Callable[..., Any], number: signal.Signals
) -> None:
    """Nobody listens, and it has hours to wait."""
    publisher = launch("target_publisher", "-p", "wait_timeout:=.inf", own_interpreter=True)
    publisher.signal(number)
    assert publisher.wait_for_exit(EXIT_PATIENCE) == 0
    assert "Traceback" not in publisher.log


@pytest.mark.parametrize("stamped", ["true", "false"])
def test_the_target_publisher_drives_the_robot_along_the_diagonal(
    launch: Callable[..., Any], client: Any, stamped: str
) -> None:
    """15 targets, 15 results, exit code 0."""
    launch("ik_node", "-p", "queue_depth:=100")
    launch("fake_robot")
    client.connect(CONTACT, "tracking_error/orientation")
    publisher = launch("target_publisher", "-p", f"stamped:={stamped}", ready=False)
    assert publisher.wait_for_exit() == 0
    assert "published 15 targets" in publisher.log
    targets = diagonal_path()
    client.wait_for_results(targets[-1], RESULTS)
    for target in targets:
        (stamp,) = client.stamps_of(target)
        assert all(client.stamps(topic).count(stamp) == 1 for topic in RESULTS)


def test_nodes_in_a_namespace_talk_to_each_other_only(
    launch: Callable[..., Any], make_client: Callable[..., Any]
) -> None:
    """Two robots side by side: what is sent to one does not move the other."""
    for namespace in ("/left", "/right"):
        launch("ik_node", "-r", f"__ns:={namespace}", ready=False)
    launch("fake_robot", "-r", "__ns:=/left")
    left, right = make_client(namespace="/left"), make_client(namespace="/right")
    right.connect(diagonal_path(5)[1])
    left.connect(CONTACT, "tracking_error/position")
    assert not left.stamps_of(diagonal_path(5)[1])
    assert not right.stamps_of(CONTACT)
    left.wait_until(lambda: left.status("left/ik_node"), "diagnostics named after the namespace")
    left.wait_until(lambda: left.status("right/ik_node"), "diagnostics of both in one place")


def test_topics_can_be_remapped(
    launch: Callable[..., Any], make_client: Callable[..., Any]
) -> None:
    """Every name is relative, so a remapping of the name alone works."""
    client = make_client(targets="wanted")
    client.listen("arm/command", JointState)
    launch("ik_node", "-r", "target_pose:=wanted", "-r", "joint_command:=arm/command")
    client.connect(CONTACT, "arm/command")
    assert not client.received["joint_command"]
