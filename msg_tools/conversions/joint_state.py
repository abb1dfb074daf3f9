"""Joint state messages as arrays in the robot's joint order, matched by name, and back.

And the messages of joint positions for the controllers of ros2_control.
"""

import math
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from numpy.typing import ArrayLike
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from annik_core.errors import MalformedJointState, MissingJoint, NonFiniteValue, WrongShape
from annik_core.pose import FloatArray


def joint_state_to_array(message: JointState, joint_names: Sequence[str]) -> FloatArray:
    """Joint positions ``(dof,)`` [rad or m] in the order of ``joint_names``.

    Other joints of the message, its velocities and its efforts are ignored.

    Raises:
        MalformedJointState: if a name occurs twice, or there is not one position per name.
        MissingJoint: if joints are not in the message; names all of them.
        NonFiniteValue: if a position is NaN or infinite; names the joint.
    """
    names = list(message.name)
    if len(names) != len(message.position):
        raise MalformedJointState(f"{len(names)} names but {len(message.position)} positions")
    positions = dict(zip(names, message.position, strict=True))
    if len(positions) != len(names):
        repeated = sorted({name for name in names if names.count(name) > 1})
        raise MalformedJointState(f"joint {', '.join(repeated)} is named more than once")
    missing = [name for name in joint_names if name not in positions]
    if missing:
        raise MissingJoint(missing, names)
    for name in joint_names:
        if not math.isfinite(positions[name]):
            raise NonFiniteValue(f"position of {name}", float(positions[name]))
    return np.array([float(positions[name]) for name in joint_names], dtype=np.float64)


def joint_state_from_array(
    joint_positions: ArrayLike, joint_names: Sequence[str], stamp: Time | None = None
) -> JointState:
    """The message of joint positions ``(dof,)`` [rad or m], without velocities and efforts.

    The stamp of the header is zero if left out.

    Raises:
        WrongShape: if there is not one position per name.
    """
    array = np.asarray(joint_positions, dtype=np.float64)
    if array.shape != (len(joint_names),):
        raise WrongShape("joint positions", array.shape, f"({len(joint_names)},), one per name")
    header = Header() if stamp is None else Header(stamp=stamp)
    return JointState(header=header, name=list(joint_names), position=array.tolist())


def joint_trajectory_from_array(
    joint_positions: ArrayLike,
    joint_names: Sequence[str],
    interval: float,
    stamp: Time | None = None,
) -> JointTrajectory:
    """The trajectory through joint positions ``(n, dof)`` [rad or m], ``interval`` [s] apart.

    The first row is due after one interval. The stamp is zero if left out: start at once.

    Raises:
        WrongShape: if a row has not one position per name.
    """
    array = np.asarray(joint_positions, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != len(joint_names):
        raise WrongShape("joint positions", array.shape, f"(n, {len(joint_names)})")
    points = [
        JointTrajectoryPoint(positions=row, time_from_start=_duration((index + 1) * interval))
        for index, row in enumerate(array.tolist())
    ]
    header = Header() if stamp is None else Header(stamp=stamp)
    return JointTrajectory(header=header, joint_names=list(joint_names), points=points)


def position_command_from_array(joint_positions: ArrayLike) -> Float64MultiArray:
    """The command of joint positions ``(dof,)`` [rad or m], in the order of the joints."""
    return Float64MultiArray(data=np.asarray(joint_positions, dtype=np.float64).tolist())


def _duration(seconds: float) -> Duration:
    whole, nanoseconds = divmod(round(1e9 * seconds), 1_000_000_000)
    return Duration(sec=whole, nanosec=nanoseconds)
