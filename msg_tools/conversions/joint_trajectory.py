"""Joint positions as messages for the controllers of ros2_control."""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration
from numpy.typing import ArrayLike
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from annik_core.errors import WrongShape


def joint_trajectory_from_array(
    joint_positions: ArrayLike, joint_names: Sequence[str], interval: float
) -> JointTrajectory:
    """The trajectory through joint positions ``(n, dof)`` [rad or m], ``interval`` [s] apart.

    The first row is due after one interval. The stamp is zero: start at once.

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
    return JointTrajectory(joint_names=list(joint_names), points=points)


def position_command_from_array(joint_positions: ArrayLike) -> Float64MultiArray:
    """The command of joint positions ``(dof,)`` [rad or m], in the order of the joints."""
    return Float64MultiArray(data=np.asarray(joint_positions, dtype=np.float64).tolist())


def _duration(seconds: float) -> Duration:
    whole, nanoseconds = divmod(round(1e9 * seconds), 1_000_000_000)
    return Duration(sec=whole, nanosec=nanoseconds)
