"""Pose messages as arrays ``(7,)`` and back: x, y, z [m], quaternion x, y, z, w; and vectors."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
    Vector3Stamped,
)
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from annik_core.errors import WrongShape
from annik_core.pose import FloatArray


def pose_to_array(message: Pose) -> FloatArray:
    """The seven numbers ``(7,)`` of a message, unchecked.

    :meth:`annik_core.IkSolver.solve` checks its target itself; elsewhere use
    :func:`annik_core.pose.checked_pose`.
    """
    p, q = message.position, message.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w], dtype=np.float64)


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
    """:func:`pose_from_array` with a stamp and the frame ``frame_id``."""
    return PoseStamped(header=Header(stamp=stamp, frame_id=frame_id), pose=pose_from_array(pose))


def transform_to_array(message: Transform) -> FloatArray:
    """The pose ``(7,)`` of the frame that a transform leads to, unchecked."""
    p, q = message.translation, message.rotation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w], dtype=np.float64)


def transform_stamped_from_array(
    pose: ArrayLike, stamp: Time, frame_id: str, child: str
) -> TransformStamped:
    """The transform from a frame to a child with the pose ``(7,)`` in it."""
    stamped = pose_stamped_from_array(pose, stamp, frame_id)
    message = TransformStamped(header=stamped.header, child_frame_id=child)
    p, translation = stamped.pose.position, message.transform.translation
    translation.x, translation.y, translation.z = p.x, p.y, p.z
    message.transform.rotation = stamped.pose.orientation
    return message


def vector3_to_array(message: Vector3) -> FloatArray:
    """The vector ``(3,)`` of a message, unchecked."""
    return np.array([float(message.x), float(message.y), float(message.z)], dtype=np.float64)


def vector3_from_array(vector: ArrayLike) -> Vector3:
    """The message of a vector ``(3,)``, unchecked.

    Raises:
        WrongShape: if ``vector`` is not three numbers.
    """
    array = np.asarray(vector, dtype=np.float64)
    if array.shape != (3,):
        raise WrongShape("vector", array.shape, "(3,): x, y, z")
    x, y, z = array.tolist()
    return Vector3(x=x, y=y, z=z)


def vector3_stamped_from_array(vector: ArrayLike, stamp: Time, frame_id: str) -> Vector3Stamped:
    """The stamped message of a vector ``(3,)`` with components along the axes of ``frame_id``."""
    return Vector3Stamped(
        header=Header(stamp=stamp, frame_id=frame_id), vector=vector3_from_array(vector)
    )
