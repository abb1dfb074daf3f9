"""Publishers of commands, in every message type that a controller may need.

Messages are serialized once and then only filled in, since converting and serializing a message
takes several times as long as publishing its bytes.
"""

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_core.serving.stamps import UniqueStamps
from annik_core.solver.result import IkResult
from annik_ros.ik_node.parameters import IkNodeParameters
from annik_ros.qos import RESULT_DEPTH, reliable
from msg_tools.conversions.joint_state import (
    joint_state_from_array,
    joint_trajectory_from_array,
    position_command_from_array,
)
from msg_tools.conversions.pose import pose_stamped_from_array
from msg_tools.conversions.stamp import split_stamp, stamp_from_nanoseconds
from msg_tools.topics import (
    ACCEPTED_TARGET,
    JOINT_COMMAND,
    JOINT_TRAJECTORY,
    POSITION_COMMANDS,
    SOLUTIONS,
)

#: A stamp that no clock has [ns].
_STAMP = -2_000_000_011_987_654_321


class MessageTemplate:
    """The bytes of a message whose header stamp and array of ``size`` numbers are replaced."""

    def __init__(self, make_message: Callable[[Time, list[float]], Any], size: int) -> None:
        # Both are found by their values, whatever the layout of the message.
        numbers = [-7.25e300 - 1e290 * index for index in range(size)]
        self._data = bytearray(_serialized(make_message(stamp_from_nanoseconds(_STAMP), numbers)))
        self._stamp = struct.Struct("=iI")
        self._numbers = struct.Struct(f"={size}d")
        self._stamp_position = self._data.index(self._stamp.pack(*split_stamp(_STAMP)))
        self._numbers_position = self._data.index(self._numbers.pack(*numbers))

    def filled(self, stamp: int, numbers: FloatArray) -> bytes:
        """The message with this stamp [ns] and these numbers ``(size,)``.

        Raises:
            InvalidStamp: if the stamp does not fit into a message.
        """
        self._stamp.pack_into(self._data, self._stamp_position, *split_stamp(stamp))
        self._numbers.pack_into(self._data, self._numbers_position, *numbers.tolist())
        return bytes(self._data)


def _serialized(message: Any) -> bytes:
    """The bytes of a message without padding at the end, which strict readers refuse."""
    data: bytes = serialize_message(message)
    while _reads_as(data[:-1], message):
        data = data[:-1]
    return data


def _reads_as(data: bytes, message: Any) -> bool:
    try:
        return bool(deserialize_message(data, type(message)) == message)
    except RuntimeError:
        return False


class CommandPublishers:
    """The publishers of commands, of one robot once :meth:`set_robot` has been called.

    They publish only while the node is active.
    """

    def __init__(self, node: LifecycleNode, options: IkNodeParameters) -> None:
        self.options = options
        self._node = node
        # The handle gives nanoseconds; making a Time takes longer than reading the clock.
        self._clock = node.get_clock().handle
        self._stamps = UniqueStamps()
        results = reliable(RESULT_DEPTH)
        # With single_threaded, rclpy looks at each event with every target. A subscriber that does
        # not fit is told by its own node too.
        no_events = PublisherEventCallbacks(use_default_callbacks=False)
        self._publishers = [
            node.create_lifecycle_publisher(
                *(message_type, topic.name, results),
                event_callbacks=None if topic is JOINT_COMMAND else no_events,
            )
            for message_type, topic in (
                (JointState, JOINT_COMMAND),
                (PoseStamped, ACCEPTED_TARGET),
                (JointTrajectory, JOINT_TRAJECTORY),
                (Float64MultiArray, POSITION_COMMANDS),
                (JointTrajectory, SOLUTIONS),
            )
        ]
        (
            self._command_publisher,
            self._target_publisher,
            self._trajectory_publisher,
            self._positions_publisher,
            self._solutions_publisher,
        ) = self._publishers
        self._last: FloatArray | None = None
        self.topic_name: str = self._command_publisher.topic_name

    def set_robot(self, robot: Robot) -> None:
        """Prepare the messages of a robot."""
        self._joint_names = robot.joint_names
        self._command = MessageTemplate(
            lambda stamp, numbers: joint_state_from_array(numbers, robot.joint_names, stamp),
            robot.dof,
        )
        self._target = MessageTemplate(
            lambda stamp, numbers: pose_stamped_from_array(numbers, stamp, robot.base_frame), 7
        )

    def publish(self, result: IkResult) -> None:
        """Publish an accepted solution and its target, with one new stamp."""
        if result.joint_positions is None or result.target is None:
            return
        self._last = result.joint_positions
        stamp = self._publish_command(result.joint_positions)
        # A message without subscribers costs thirty times as much as counting them.
        if self._target_publisher.get_subscription_count():
            self._target_publisher.publish(self._target.filled(stamp, result.target))

    def publish_path(self, joint_positions: FloatArray) -> None:
        """Publish a path ``(n, dof)`` as a trajectory.

        Afterwards there is no command to repeat: the robot may still be far from its end.
        """
        self._last = None
        self._trajectory_publisher.publish(self._trajectory(joint_positions))

    def publish_solutions(self, solutions: Sequence[IkResult], stamp: int) -> None:
        """Publish all solutions of a pose, with the stamp of the request [ns]."""
        rows = np.array([one.joint_positions for one in solutions])
        rows, names = rows.reshape(-1, len(self._joint_names)), self._joint_names
        message = joint_trajectory_from_array(rows, names, 0.0, stamp_from_nanoseconds(stamp))
        self._solutions_publisher.publish(message)

    def repeat(self) -> None:
        """Publish the last command again with a new stamp, if there was one."""
        if self._last is not None:
            self._publish_command(self._last)

    def forget(self) -> None:
        """Forget the last command."""
        self._last = None

    def destroy(self) -> None:
        """Destroy the publishers."""
        for publisher in self._publishers:
            self._node.destroy_lifecycle_publisher(publisher)

    def _publish_command(self, joint_positions: FloatArray) -> int:
        """Publish joint positions on all enabled topics; returns their stamp [ns]."""
        stamp = self._stamps.next(self._clock.get_now().nanoseconds)
        self._command_publisher.publish(self._command.filled(stamp, joint_positions))
        if self.options.publish_joint_trajectory:
            self._trajectory_publisher.publish(self._trajectory(joint_positions[np.newaxis]))
        if self.options.publish_position_commands:
            self._positions_publisher.publish(position_command_from_array(joint_positions))
        return stamp

    def _trajectory(self, joint_positions: FloatArray) -> JointTrajectory:
        return joint_trajectory_from_array(
            joint_positions, self._joint_names, self.options.trajectory_interval
        )
