"""Where the robot is, by the newest joint states that name all of its joints."""

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

#: How many messages to look through: others may publish the states of a gripper in between.
_KEPT: Final = 20


class MeasuredJointPositions:
    """Keeps the newest joint states as they came, and reads them only when asked.

    A robot publishes its state hundreds of times a second; few commands ask for it.

    Attributes:
        timeout: what came longer ago than this counts for nothing [s].
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
        """The joint positions ``(dof,)`` [rad or m] of the newest message that has them all.

        None if there is none, or only such as are too old.
        """
        newest = self.newest()
        return None if newest is None else newest[1]

    def newest(self) -> tuple[float, FloatArray] | None:
        """When the newest message that has all joints came [s, monotonic], and their positions.

        None likewise.
        """
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
        """The topic that it reads, with the namespace and as it is remapped."""
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
            # Not for this robot, or not a joint state at all; an older one may do.
            return None
