"""The problem that every solver of the benchmark is given, made of a robot."""

from __future__ import annotations

from annik_core.errors import AnnikError
from annik_core.robots.robot import Robot
from benchmarks.ik.peers.problem import IkProblem


class NotAnArm(AnnikError):
    """The benchmark needs a URDF, which only arms have."""

    def __init__(self, robot: str) -> None:
        self.robot = robot
        super().__init__(f"{robot} is not an arm: this benchmark needs the URDF of a serial arm")


def robot_problem(robot: Robot) -> IkProblem:
    """Chain, frames, limits and joint box of an arm, for the solvers.

    Raises:
        NotAnArm: if it is none.
    """
    if robot.kind != "arm":
        raise NotAnArm(robot.name)
    # The solvers take a joint without limits for one with those of its box.
    lower, upper = robot.joint_limits.lower.copy(), robot.joint_limits.upper.copy()
    lower[robot.turning] = robot.joint_box.lower[robot.turning]
    upper[robot.turning] = robot.joint_box.upper[robot.turning]
    return IkProblem(
        urdf=str(robot.definition["urdf"]),
        base_frame=robot.base_frame,
        end_effector_frame=robot.end_effector_frame,
        joint_names=robot.joint_names,
        lower=lower,
        upper=upper,
        box_lower=robot.joint_box.lower,
        box_upper=robot.joint_box.upper,
    )
