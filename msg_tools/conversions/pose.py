"""Pose messages as arrays ``(7,)`` and back: x, y, z [m], quaternion x, y, z, w."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from annik_core.errors import WrongShape
from annik_core.pose import FloatArray


def pose_to_array(message: Pose) -> FloatArray:
    """The seven numbers ``(7,)`` of a message, unchecked.

    :meth:`annik_core.IkSolver.solve` checks its target itself; elsewhere use
    :func:`annik_core.pose.checked_pose`.
    """
    position, orientation = message.position, message.orientation
    return np.array(
        [
            float(position.x),
            float(position.y),
            float(position.z),
            float(orientation.x),
            float(orientation.y),
            float(orientation.z),
            float(orientation.w),
        ],
        dtype=np.float64,
    )


def pose_from_array(pose: ArrayLike) -> Pose:
    """The message of a pose ``(7,)``, unchecked.

    Raises:
        WrongShape: if ``pose`` is not seven numbers.
    """
    array = np.asarray(pose, dtype=np.float64)
    if array.shape != (7,):
        raise WrongShape("pose", array.shape, "(7,): x, y, z, qx, qy, qz, qw")
    # rclpy writes anything but Python floats into a float64 field as garbage.
    x, y, z, qx, qy, qz, qw = array.tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def pose_stamped_from_array(pose: ArrayLike, stamp: Time, frame_id: str) -> PoseStamped:
    """The stamped message of a pose ``(7,)`` in the frame ``frame_id``, unchecked.

    Raises:
        WrongShape: if ``pose`` is not seven numbers.
    """
    return PoseStamped(header=Header(stamp=stamp, frame_id=frame_id), pose=pose_from_array(pose))
