"""The paper's "known method": the joint positions that reach a regular grid of poses."""

import itertools

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.gantry import GantryKinematics, GantryWorkspace
from annik_core.robots.robot import Robot
from annik_training.designs.grid import distinct_rows
from annik_training.errors import UnsupportedRobot


def workspace_grid_design(
    robot: Robot, positions_per_axis: int, *, orientation_levels: int = 1
) -> FloatArray:
    """Joint positions of every grid position in every grid orientation, section 3 and Table 7.

    The orientations are: none, then roll, pitch or yaw alone at each of ``orientation_levels``
    equal fractions of its range. The paper's Set 1 is 3 positions per axis and 1 level (108), Set
    2 is 4 and 1 (256), Set 3 is 4 and 2 (448).

    Returns:
        ``(n, 6)`` drive angles [rad], x varying fastest, then y, z, orientation, as in Table 8.

    Raises:
        UnsupportedRobot: if the robot is not a gantry, whose inverse is known, eq. (3)-(4).
    """
    kinematics, workspace = robot.forward_kinematics, robot.workspace
    if not isinstance(kinematics, GantryKinematics) or not isinstance(workspace, GantryWorkspace):
        raise UnsupportedRobot(
            "design workspace_grid",
            robot.name,
            "it needs an inverse in closed form, which only the gantry has",
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
    # Along the coordinate of a locked joint all grid positions coincide.
    task = workspace.lower + distinct_rows(fraction * (width > 0)) * width
    return kinematics.joint_positions(task)
