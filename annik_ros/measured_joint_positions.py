"""Measured joint positions, from the newest joint states that name all joints of the robot."""

from __future__ import annotations

import time
from collections import deque
from typing import Final

from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray
from msg_tools.conversions.joint_state import joint_state_to_array
from msg_tools.topics import JOINT_STATES

#: How many messages are kept: another publisher may send the states of a gripper in between.
_KEPT: Final = 20


class MeasuredJointPositions:
    """Keeps the newest joint states undecoded, and decodes them on request.

    A robot publishes its state hundreds of times a second; few commands need it.

    Attributes:
        timeout: older measurements are ignored [s].
    """

    def __init__(self, node: Node, joint_names: tuple[str, ...], timeout: float) -> None:
        """Subscribe on ``node``."""
        self.timeout = timeout
        self._node = node
        self._joint_names = joint_names
        self._kept: deque[tuple[float, bytes]] = deque(maxlen=_KEPT)
        self._subscription = node.create_subscription(
            JointState, JOINT_STATES.name, self._on_message, qos_profile_sensor_data, raw=True
        )

    def __call__(self) -> FloatArray | None:
        """The joint positions ``(dof,)`` [rad or m] of the newest message with all joints.

        None if there is none, or it is too old.
        """
        newest = self.newest()
        return None if newest is None else newest[1]

    def newest(self) -> tuple[float, FloatArray] | None:
        """Time of arrival [s, monotonic] and joint positions of that message; None likewise."""
        oldest = time.monotonic() - self.timeout
        for arrival, data in reversed(self._kept):
            if arrival < oldest:
                return None
            positions = self._read(data)
            if positions is not None:
                return arrival, positions
        return None

    @property
    def topic_name(self) -> str:
        """The topic with its namespace, after remapping."""
        return str(self._subscription.topic_name)

    def destroy(self) -> None:
        """Take the subscription off the node."""
        self._node.destroy_subscription(self._subscription)

    def _on_message(self, data: bytes) -> None:
        self._kept.append((time.monotonic(), data))

    def _read(self, data: bytes) -> FloatArray | None:
        try:
            message = deserialize_message(data, JointState)
            return joint_state_to_array(message, self._joint_names)
        except (AnnikError, RuntimeError, ValueError):
            # Of another robot, or not a joint state; an older message may have all joints.
            return None
