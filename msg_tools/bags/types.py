"""Message types of ROS 2 Jazzy, without ROS."""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore


@cache
def jazzy_types() -> Typestore:
    """The store of the message types that come with ROS 2 Jazzy; shared: do not extend it."""
    return get_typestore(Stores.ROS2_JAZZY)


def is_known_type(message_type: str) -> bool:
    """Whether a type, such as ``geometry_msgs/msg/Pose``, comes with ROS 2 Jazzy."""
    return message_type in jazzy_types().fielddefs
