"""The first command after an activation, and where the robot was measured to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from invariants import good_target, wait_for_counts
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from support.processes import PATIENCE

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray
from annik_core.solver.ik_solver import IkSolver
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds

SOLVER = IkSolver.from_file(default_model_path())


class _Robot:
    """Publishes joint states, as a robot's driver does; and a gripper's, as another's does."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._publisher = client.node.create_publisher(
            JointState, "joint_states", qos_profile_sensor_data
        )
        client.wait_until(self._publisher.get_subscription_count, "the node listens")

    def is_at(self, positions: FloatArray, grippers: int = 0) -> None:
        names = SOLVER.robot.joint_names
        self._publisher.publish(
            joint_state_from_array(positions, names, stamp_from_nanoseconds(0))
        )
        for _ in range(grippers):
            self._publisher.publish(
                joint_state_from_array([0.1], ("finger",), stamp_from_nanoseconds(0))
            )
        # Two topics are independent of each other: only time makes an order.
        self._client.take_messages(0.1)


def test_the_first_command_must_be_near_the_measured_joint_positions(
    launch: Callable[..., Any], client: Any
) -> None:
    """Not measured, measured too long ago, far away: refused. Near, gripper or not: answered."""
    node = launch(
        "ik_node",
        *("-p", "first_command:=near", "-p", "queue_depth:=100", "-p", "max_first_step:=0.1"),
        *("-p", f"measurement_timeout:={PATIENCE}"),
    )
    near = SOLVER.solve(good_target(0)).joint_positions
    assert near is not None
    robot = _Robot(client)
    sent = 0

    def send() -> None:
        nonlocal sent
        sent += 1
        client.send(good_target(sent))

    def is_answered() -> None:
        client.wait_for_results(good_target(sent), ["joint_command"])

    def set_parameter(name: str, value: object) -> None:
        assert client.set_parameter("ik_node", name, value).successful

    def let_the_measurement_grow_old() -> None:
        set_parameter("measurement_timeout", 0.1)
        client.take_messages(0.2)

    def be_far_and_send() -> None:
        robot.is_at(near + np.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
        send()

    send()
    node.wait_for_text("where the robot is has not been measured")
    # What is published before the node knows the robot is lost.
    client.repeat_until(
        be_far_and_send, lambda: "is measured at" in node.log, "the node hears the robot"
    )
    robot.is_at(near)
    let_the_measurement_grow_old()
    send()
    counts = wait_for_counts(client, sent)
    assert counts.reasons == {"first command too far": sent}
    assert not client.received["joint_command"]
    set_parameter("measurement_timeout", PATIENCE)
    robot.is_at(near, grippers=4)
    send()
    is_answered()
    # From here on, the last command says where the robot is.
    let_the_measurement_grow_old()
    send()
    is_answered()
    # Somebody may have moved it while nothing was commanded.
    assert client.change_state("ik_node", "deactivate")
    assert client.change_state("ik_node", "activate")
    send()
    refused = counts.refused + 1
    assert wait_for_counts(client, sent).reasons == {"first command too far": refused}
    # Enough for some: nobody measures, so nobody knows better.
    set_parameter("first_command", "near_if_measured")
    set_parameter("measurement_timeout", PATIENCE)
    robot.is_at(near + 0.2)
    send()
    refused += 1
    assert wait_for_counts(client, sent).reasons == {"first command too far": refused}
    let_the_measurement_grow_old()
    send()
    is_answered()
    # The rule for every command, not for the first alone.
    set_parameter("max_measured_step", 0.1)
    set_parameter("measurement_timeout", PATIENCE)
    robot.is_at(near + 0.2)
    send()
    reasons = {"first command too far": refused, "too far from measured": 1}
    assert wait_for_counts(client, sent).reasons == reasons
    robot.is_at(near)
    send()
    is_answered()
    assert len(client.received["joint_command"]) == 4
