"""What a command must satisfy, and every form in which it is published, over DDS."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseArray
from invariants import (
    GOOD,
    UNREACHABLE,
    assert_all_numbers_finite,
    connect,
    good_target,
    listen_to_all_commands,
    path_message,
    settled,
    wait_for_counts,
)
from support.processes import PATIENCE

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray
from annik_core.solver.ik_solver import IkSolver
from annik_core.target_paths import diagonal_path
from msg_tools.conversions.stamp import stamp_from_nanoseconds

SOLVER = IkSolver.from_file(default_model_path())


def _moved(distance: float) -> FloatArray:
    return GOOD + np.array([distance, 0, 0, 0, 0, 0, 0])


def test_limits_hold_from_the_next_target_on_and_contradictions_are_refused_whole(
    launch: Callable[..., Any], client: Any
) -> None:
    """Velocity, workspace box and age of a target, each counted by its own name."""
    node = launch("ik_node", "-p", "queue_depth:=100")
    received = connect(client)
    reasons: dict[str, int] = {}

    def change(**values: object) -> bool:
        return bool(client.set_parameters_atomically("ik_node", values).successful)

    def refused(reason: str, send: Callable[[], None]) -> None:
        nonlocal received
        send()
        received += 1
        reasons[reason] = reasons.get(reason, 0) + 1
        assert wait_for_counts(client, received).reasons == reasons

    def answered(number: int) -> None:
        nonlocal received
        client.send(good_target(number))
        client.wait_for_results(good_target(number), ["joint_command"])
        received += 1

    # At this rate, two commands count as half a second apart even if they come at once.
    assert change(max_joint_velocity=0.01, expected_rate=2.0)
    answered(1)
    refused("joint velocity too large", lambda: client.send(_moved(0.1)))
    answered(2)
    assert change(max_joint_velocity=math.inf, expected_rate=0.0)

    everywhere = [-math.inf] * 3, [math.inf] * 3
    assert change(workspace_box_lower=[0.0, 0.0, 0.0], workspace_box_upper=[0.35, 1.0, 1.0])
    refused("outside workspace box", lambda: client.send(_moved(0.1)))
    answered(3)
    # One after the other, the first of these would leave an empty box.
    wrong = client.set_parameter("ik_node", "workspace_box_lower", [0.5, 0.0, 0.0])
    assert not wrong.successful
    assert "workspace_box_upper" in wrong.reason
    assert not change(max_joint_step=1e-9, workspace_box_upper=[-1.0, 1.0, 1.0])
    assert not change(max_joint_step=1e-9, workspace_box_lower=[0.0, 0.0])
    assert not change(max_joint_step=1e-9, first_command="anywhere")
    assert not change(max_joint_step=1e-9, max_target_age=math.nan)
    assert not change(max_joint_step=1e-9, queue_depth=7)
    answered(400)
    assert change(workspace_box_lower=[0.5, 0.0, 0.0], workspace_box_upper=[0.9, 1.0, 1.0])
    refused("outside workspace box", lambda: client.send(good_target(4)))
    assert change(workspace_box_lower=everywhere[0], workspace_box_upper=everywhere[1])
    answered(5)

    assert change(max_target_age=30.0)
    now = client.node.get_clock().now().nanoseconds
    # The last of them has no stamp at all.
    for seconds in (-3600, -31, 60, 3600, -now * 1e-9):
        message = client.pose_stamped(good_target(6), now + int(1e9 * seconds), "base_link")
        client.stamped_target.publish(message)
    received += 5
    reasons["stale target"] = 5
    message.header.stamp.nanosec = 10**9
    refused("malformed message", lambda: client.stamped_target.publish(message))
    client.send_stamped(good_target(7), "base_link")
    client.wait_for_results(good_target(7), ["joint_command"])
    # A plain target has no stamp and so no age.
    received += 1
    answered(8)
    assert not client.stamps_of(good_target(6))
    assert "Traceback" not in node.log


def test_a_hold_repeats_the_last_accepted_command_under_a_new_stamp(
    launch: Callable[..., Any], client: Any
) -> None:
    """In every form that is published, and never before there was a command."""
    listen_to_all_commands(client)
    launch(
        "ik_node",
        *("-p", "on_refusal:=hold", "-p", "queue_depth:=100"),
        *("-p", "publish_joint_trajectory:=true", "-p", "publish_position_commands:=true"),
        *("-p", "trajectory_interval:=0.25"),
    )
    topics = ("joint_command", "joint_trajectory", "position_commands")
    client.send(UNREACHABLE)
    wait_for_counts(client, 1)
    assert not any(client.received[topic] for topic in topics)
    received = connect(client)
    client.send(good_target(1))
    for bad in (UNREACHABLE, np.full(7, math.nan)):
        client.send(bad)
    for topic in topics:
        client.wait_until(lambda topic=topic: len(client.received[topic]) == 3, topic)
    counts = wait_for_counts(client, received + 3)
    assert (counts.accepted, counts.refused) == (received, 3)
    assert len(client.received["accepted_target"]) == 1
    stamps = client.stamps("joint_command")
    assert stamps == sorted(set(stamps))
    assert_all_numbers_finite(client)
    expected = SOLVER.solve(good_target(1)).joint_positions
    for command, trajectory, positions in zip(
        *(client.received[topic][-3:] for topic in topics), strict=True
    ):
        np.testing.assert_allclose(command.position, expected, rtol=0, atol=1e-9)
        assert list(positions.data) == list(command.position)
        (point,) = trajectory.points
        assert list(point.positions) == list(command.position)
        assert list(trajectory.joint_names) == list(SOLVER.robot.joint_names)
        assert (point.time_from_start.sec, point.time_from_start.nanosec) == (0, 250_000_000)
        assert trajectory.header.stamp == stamp_from_nanoseconds(0)
    # After a deactivation there is no last command again.
    assert client.change_state("ik_node", "deactivate")
    assert client.change_state("ik_node", "activate")
    client.send(UNREACHABLE)
    wait_for_counts(client, received + 4)
    assert len(client.received["joint_command"]) == 3
    # Nor is there after a path, whose end the robot may not have reached.
    paths = client.node.create_publisher(PoseArray, "target_poses", 10)
    client.wait_until(paths.get_subscription_count, "the node listens to paths")
    client.send(good_target(2))
    client.wait_until(lambda: len(client.received["joint_command"]) == 4, "another command")

    def path_answered() -> bool:
        return len(client.received["joint_trajectory"][-1].points) == 2

    client.repeat_until(
        lambda: paths.publish(path_message([good_target(2), good_target(1)])),
        path_answered,
        "a path's answer",
    )
    client.send(UNREACHABLE)
    client.wait_for_status(
        "ik_node", lambda values: values["targets refused"] == "5", "the refusal"
    )
    assert len(client.received["joint_command"]) == 4


def test_a_path_is_answered_whole_or_not_at_all(launch: Callable[..., Any], client: Any) -> None:
    """As one trajectory; a refusal names the first pose that it is for."""
    listen_to_all_commands(client)
    node = launch("ik_node", "-p", "queue_depth:=100", "-p", "max_path_poses:=20")
    publisher = client.node.create_publisher(PoseArray, "target_poses", 10)
    path = [GOOD, *diagonal_path()]
    trajectories = client.received["joint_trajectory"]
    counts = iter(range(len(path), 1, -1))
    sent: list[int] = []

    def send_another() -> None:
        sent.append(next(counts))
        publisher.publish(path_message(path[: sent[-1]]))

    # What was sent before the newest one has come before it, or never will.
    client.repeat_until(
        send_another,
        lambda: trajectories and len(trajectories[-1].points) == sent[-1],
        "a path's answer",
        pause=PATIENCE / len(path),
    )
    received = settled(client)
    not_finite = GOOD * [1, math.nan, *[1] * 5]
    for poses in ([], [GOOD] * 21, [not_finite, *path], [*path[:3], UNREACHABLE, UNREACHABLE]):
        publisher.publish(path_message(poses))
    publisher.publish(path_message(path[:5], "base_link"))
    client.wait_until(lambda: trajectories, "the next good path's answer")
    counts = wait_for_counts(client, received + 5)
    assert counts.reasons == {"path length": 2, "not finite": 1, "outside workspace": 1}
    found = client.status("ik_node")
    assert found is not None
    assert "pose 3 of 0 to 4: x is 2 m" in found[1]["last refusal"]
    (answer,) = trajectories
    reached = SOLVER.robot.forward_kinematics.poses(
        np.array([point.positions for point in answer.points])
    )
    np.testing.assert_allclose(reached[:, :3], np.array(path[:5])[:, :3], rtol=0, atol=1e-3)
    assert_all_numbers_finite(client)
    # Its stamp counts as that of a target does.
    assert client.set_parameter("ik_node", "max_target_age", 3600.0).successful
    for stamp in (Time(), client.node.get_clock().now().to_msg()):
        message = path_message(path[:4])
        message.header.stamp = stamp
        publisher.publish(message)
    client.wait_until(lambda: len(trajectories[-1].points) == 4, "the fresh path's answer")
    counts = wait_for_counts(client, received + 7)
    assert (counts.reasons["stale target"], len(trajectories)) == (1, 2)
    # A path is a trajectory; the topics of single commands are silent about it.
    assert not client.received["joint_command"]
    assert "Traceback" not in node.log
