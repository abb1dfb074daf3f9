"""The systems to learn, by name: every packaged robot, and the analytic ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache

from annik_core.robots.library import load_robot
from annik_training.fitting.problem import InverseKinematicsSystem, System
from benchmarks.systems.elbow_arm import ElbowArm
from benchmarks.systems.function_system import interaction, paper_functions

#: Systems in closed form, which have no ROS side.
ANALYTIC_SYSTEMS: Mapping[str, Callable[[], System]] = {
    "F": paper_functions,
    "elbow_arm": ElbowArm,
    "interaction": interaction,
}


@lru_cache
def load_system(name: str) -> System:
    """An analytic system, or else the inverse kinematics of a robot.

    Args:
        name: a key of :data:`ANALYTIC_SYSTEMS`, a packaged robot, or a robot definition's path.

    Raises:
        RobotError: if there is no such robot, or its definition can't be used.
    """
    if name in ANALYTIC_SYSTEMS:
        return ANALYTIC_SYSTEMS[name]()
    return InverseKinematicsSystem(load_robot(name))
