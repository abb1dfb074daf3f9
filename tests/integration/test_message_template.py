"""Messages that are filled in are, byte for byte, what a reader of another make expects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState

from annik_core.pose import FloatArray
from annik_ros.ik_node.publishers import MessageTemplate
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import pose_stamped_from_array

STAMP = 1_234_567_890_123_456_789
JAZZY = get_typestore(Stores.ROS2_JAZZY)


def _joint_state(count: int) -> Callable[..., Any]:
    names = tuple("a_joint_name"[: 4 + index] for index in range(count))
    return lambda stamp, numbers: joint_state_from_array(numbers, names, stamp)


def _stamped_pose(stamp: Any, numbers: Any) -> Any:
    return pose_stamped_from_array(np.array(numbers), stamp, "base_link")


@pytest.mark.parametrize("count", range(1, 8))
def test_a_filled_joint_state_ends_where_the_message_ends(count: int) -> None:
    """Whatever the alignment of what is before its end; rosbags reads nothing else."""
    numbers = np.linspace(-1.0, 1.0, count)
    data = MessageTemplate(_joint_state(count), count).filled(STAMP, numbers)
    message = JAZZY.deserialize_cdr(data, "sensor_msgs/msg/JointState")
    np.testing.assert_array_equal(message.position, numbers)
    assert len(JAZZY.serialize_cdr(message, "sensor_msgs/msg/JointState")) == len(data)
    assert list(deserialize_message(data, JointState).position) == numbers.tolist()


def test_a_filled_pose_has_its_stamp_and_numbers() -> None:
    """And no others, also when it was filled before."""
    template = MessageTemplate(_stamped_pose, 7)
    poses: list[FloatArray] = [np.arange(7.0), -np.arange(7.0)]
    for stamp, pose in zip((STAMP, 5), poses, strict=True):
        data = template.filled(stamp, pose)
        message = JAZZY.deserialize_cdr(data, "geometry_msgs/msg/PoseStamped")
        assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
        assert message.header.frame_id == "base_link"
        assert (message.pose.position.y, message.pose.orientation.w) == (pose[1], pose[6])
