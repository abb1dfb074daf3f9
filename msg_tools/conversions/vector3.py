"""Vector3 messages as arrays ``(3,)`` and back, in any unit."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3, Vector3Stamped
from numpy.typing import ArrayLike
from std_msgs.msg import Header

from annik_core.errors import WrongShape
from annik_core.pose import FloatArray


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
