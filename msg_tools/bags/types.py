"""The message types of ROS 2 Jazzy, without ROS: their text, their hash, and CDR decoding."""

from __future__ import annotations

from functools import cache

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore


@cache
def jazzy_types() -> Typestore:
    """The store of the message types that come with ROS 2 Jazzy; shared, so don't extend it."""
    return get_typestore(Stores.ROS2_JAZZY)


def is_known_type(message_type: str) -> bool:
    """Whether a type, such as ``geometry_msgs/msg/Pose``, comes with ROS 2 Jazzy."""
    return message_type in jazzy_types().fielddefs


def message_definition(message_type: str) -> str:
    """Text of a type and of all types in it, in the ``ros2msg`` form that bags hold.

    Args:
        message_type: a type for which :func:`is_known_type` is true.
    """
    return jazzy_types().generate_msgdef(message_type, ros_version=2)[0]


def type_hash(message_type: str) -> str:
    """The ``RIHS01_...`` hash by which ROS 2 tells versions of a type apart.

    Args:
        message_type: a type for which :func:`is_known_type` is true.
    """
    return jazzy_types().hash_rihs01(message_type)
