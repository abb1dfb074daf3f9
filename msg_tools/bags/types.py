"""Message types of ROS 2 Jazzy, without ROS: definition, hash and CDR decoding."""

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


def message_definition(message_type: str) -> str:
    """Text of a known type and of all types in it, in the ``ros2msg`` form of bags."""
    return jazzy_types().generate_msgdef(message_type, ros_version=2)[0]


def type_hash(message_type: str) -> str:
    """The ``RIHS01_...`` hash of a known type, by which ROS 2 tells its versions apart."""
    return jazzy_types().hash_rihs01(message_type)
