"""Pose messages as arrays ``(7,)``: x, y, z [m], unit quaternion x, y, z, w; and back."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from annik_core.errors import WrongShape
from annik_core.pose import FloatArray, checked_pose


def pose_from_message(message: Pose) -> FloatArray:
    """The pose ``(7,)`` of a message, checked, with the quaternion normalised.

    Raises:
        NonFiniteValue: if a field is NaN or infinite; names it.
        NotUnitQuaternion: if the quaternion's norm is too far from one, or zero.
    """
    return checked_pose(unchecked_pose_from_message(message))


def unchecked_pose_from_message(message: Pose) -> FloatArray:
    """The seven numbers ``(7,)`` of a message as they are.

    For a reader that makes and reports its own checks, such as
    :meth:`annik_core.solver.ik_solver.IkSolver.solve`.
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


def pose_to_message(pose: ArrayLike) -> Pose:
    """The message of a pose ``(7,)``; the numbers go out as they are.

    Raises:
        WrongShape: if ``pose`` is not seven numbers.
    """
    array = np.asarray(pose, dtype=np.float64)
    if array.shape != (7,):
        raise WrongShape("pose", array.shape, "(7,): x, y, z, qx, qy, qz, qw")
    # tolist() gives Python floats: rclpy writes anything else into a float64 field as garbage.
    x, y, z, qx, qy, qz, qw = array.tolist()
    return Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))


def pose_stamped_to_message(pose: ArrayLike, stamp: Time, frame_id: str) -> PoseStamped:
    """The stamped message of a pose ``(7,)`` in the frame ``frame_id``.

    Raises:
        WrongShape: if ``pose`` is not seven numbers.
    """
    return PoseStamped(header=Header(stamp=stamp, frame_id=frame_id), pose=pose_to_message(pose))
