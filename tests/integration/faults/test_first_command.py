"""The first command after an activation, and where the robot was measured to be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from invariants import good_target, wait_for_counts
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from annik_core.model.artifact import default_model_path
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
        # The other side may know of it a moment later.
        client.take_messages(0.3)

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
        *("-p", "measurement_timeout:=0.3"),
    )
    positions = SOLVER.solve(good_target(0)).joint_positions
    assert positions is not None
    robot = _Robot(client)
    client.send(good_target(1))
    node.wait_for_line("where the robot is has not been measured")
    robot.is_at(positions)
    client.take_messages(0.4)
    client.send(good_target(2))
    client.take_messages(0.2)
    robot.is_at(positions + np.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.0]))
    client.send(good_target(3))
    assert wait_for_counts(client, 3).reasons == {"first command too far": 3}
    assert not client.received["joint_command"]
    robot.is_at(positions, grippers=4)
    client.send(good_target(4))
    client.wait_for_results(good_target(4), ["joint_command"])
    # From here on, the last command says where the robot is.
    client.take_messages(0.4)
    client.send(good_target(5))
    client.wait_for_results(good_target(5), ["joint_command"])
    # Somebody may have moved it while nothing was commanded.
    assert client.change_state("ik_node", "deactivate")
    assert client.change_state("ik_node", "activate")
    client.send(good_target(6))
    client.take_messages(0.2)
    # Enough for some: nobody measures, so nobody knows better.
    assert client.set_parameter("ik_node", "first_command", "near_if_measured").successful
    robot.is_at(positions + 0.2)
    client.send(good_target(7))
    assert wait_for_counts(client, 7).reasons == {"first command too far": 5}
    client.take_messages(0.4)
    client.send(good_target(8))
    client.wait_for_results(good_target(8), ["joint_command"])
    # The rule for every command, not for the first alone.
    assert client.set_parameter("ik_node", "max_measured_step", 0.1).successful
    robot.is_at(positions + 0.2)
    client.send(good_target(9))
    counts = wait_for_counts(client, 9)
    assert counts.reasons == {"first command too far": 5, "too far from measured": 1}
    robot.is_at(positions)
    client.send(good_target(10))
    client.wait_for_results(good_target(10), ["joint_command"])
    assert len(client.received["joint_command"]) == 4
