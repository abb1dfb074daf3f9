"""The paper's "known method": a regular grid of poses, and the joint positions that reach it."""

from __future__ import annotations

import itertools

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.gantry import GantryKinematics, GantryWorkspace
from annik_core.robots.robot import Robot
from annik_training.designs.errors import InvalidDesignSize, UnsupportedRobotForDesign
from annik_training.designs.grid import distinct_rows

NAME = "workspace_grid"
MAX_POSITIONS_PER_AXIS = 100
MAX_ORIENTATION_LEVELS = 100


def workspace_grid_design(
    robot: Robot, positions_per_axis: int, *, orientation_levels: int = 1
) -> FloatArray:
    """Joint positions of every grid position in every grid orientation, section 3 and Table 7.

    The orientations are: none, then roll, pitch or yaw alone at each of ``orientation_levels``
    equal fractions of its range. The paper's Set 1 is 3 positions per axis and 1 level (108), Set
    2 is 4 and 1 (256), Set 3 is 4 and 2 (448).

    Args:
        robot: a gantry, whose inverse is known, eq. (3)-(4).
        positions_per_axis: grid positions on each of x, y, z.
        orientation_levels: fractions of the range of each angle.

    Returns:
        ``(n, 6)`` drive angles [rad], x varying fastest, then y, z, orientation, as in Table 8.

    Raises:
        InvalidDesignSize: if a number is out of range.
        UnsupportedRobotForDesign: if the robot is not a gantry.
    """
    kinematics, workspace = robot.forward_kinematics, robot.workspace
    if not isinstance(kinematics, GantryKinematics) or not isinstance(workspace, GantryWorkspace):
        raise UnsupportedRobotForDesign(
            NAME, robot.name, "it needs an inverse in closed form, which only the gantry has"
        )
    if not 2 <= positions_per_axis <= MAX_POSITIONS_PER_AXIS:
        raise InvalidDesignSize(
            NAME, "positions per axis", positions_per_axis, 2, MAX_POSITIONS_PER_AXIS
        )
    if not 1 <= orientation_levels <= MAX_ORIENTATION_LEVELS:
        raise InvalidDesignSize(
            NAME, "orientation levels", orientation_levels, 1, MAX_ORIENTATION_LEVELS
        )
    axis = np.linspace(0.0, 1.0, positions_per_axis)
    positions = [(x, y, z) for z, y, x in itertools.product(axis, axis, axis)]
    orientations = [(0.0, 0.0, 0.0)]
    for level in range(1, orientation_levels + 1):
        orientations += [tuple(turn) for turn in np.eye(3) * (level / orientation_levels)]
    fraction = np.array(
        [position + orientation for orientation in orientations for position in positions]
    )
    width = workspace.upper - workspace.lower
    # Along the coordinate of a locked joint all grid positions are one.
    task = workspace.lower + distinct_rows(fraction * (width > 0)) * width
    return kinematics.joint_positions(task)
