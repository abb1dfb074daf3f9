"""The systems to learn, by name, with their errors: packaged robots, and analytic ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Protocol

import numpy as np

from annik_core.pose import FloatArray, pose_distance, roll_pitch_yaw
from annik_core.robots.gantry import GantryWorkspace
from annik_core.robots.library import load_robot
from annik_training.fitting.problem import InverseKinematicsSystem, System
from benchmarks.systems.elbow_arm import ElbowArm
from benchmarks.systems.function_system import interaction, paper_functions


class MeasuredSystem(System, Protocol):
    """A system with a measure of how wrong outputs are."""

    @property
    def error_unit(self) -> str:
        """Unit of :meth:`errors`."""

    def errors(self, joint_positions: FloatArray, outputs: FloatArray) -> FloatArray:
        """Errors ``(n,)`` of outputs ``(n, k)`` at joint positions ``(n, dof)``."""


class RobotSystem(InverseKinematicsSystem):
    """The inverse kinematics of a robot."""

    error_unit = "mm"

    def encoded(self, poses: FloatArray) -> FloatArray:
        """Features ``(n, m)``; those of the gantry are computed without torch.

        The last bit of torch's roots and arctangents differs between processors, whatever
        :mod:`benchmarks.same_rounding` sets, and fits would not repeat.
        """
        if not isinstance(self.robot.workspace, GantryWorkspace):
            return super().encoded(poses)
        return np.array([[*pose[:3], *roll_pitch_yaw(pose[3:])] for pose in poses.tolist()])

    def errors(self, joint_positions: FloatArray, outputs: FloatArray) -> FloatArray:
        """Distances [mm] of the end effector at the outputs from that at the joint positions."""
        forward = self.robot.forward_kinematics
        distances, _ = pose_distance(forward.poses(joint_positions), forward.poses(outputs))
        return 1e3 * distances


#: Systems in closed form, which have no ROS side.
ANALYTIC_SYSTEMS: Mapping[str, Callable[[], MeasuredSystem]] = {
    "F": paper_functions,
    "elbow_arm": ElbowArm,
    "interaction": interaction,
}


@lru_cache
def load_system(name: str) -> MeasuredSystem:
    """An analytic system, or else the inverse kinematics of a robot.

    Args:
        name: a key of :data:`ANALYTIC_SYSTEMS`, a packaged robot, or a robot definition's path.

    Raises:
        RobotError: if there is no such robot, or its definition can't be used.
    """
    if name in ANALYTIC_SYSTEMS:
        return ANALYTIC_SYSTEMS[name]()
    return RobotSystem(load_robot(name))
