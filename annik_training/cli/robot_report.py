"""What a person should know of a robot before training: is its working box on one branch?"""

from __future__ import annotations

import numpy as np
import yaml

from annik_core.robots.robot import Robot
from annik_training.designs.sampling import compute_random_dataset
from annik_training.fitting.branches import branch_signs

_SAMPLES = 5000
#: From this width on the two ends of a joint's interval are neighbours [rad].
_NEARLY_A_TURN = 2.0 * np.pi - 0.2


def branch_shares(robot: Robot) -> str:
    """A line on how much of the working box lies on which side of a singularity."""
    if robot.kind != "arm":
        return "one branch: every pose of the workspace has one solution"
    turns = [
        name
        for name, kind, width in zip(
            robot.joint_names,
            robot.joint_types,
            robot.joint_box.upper - robot.joint_box.lower,
            strict=True,
        )
        if kind == "revolute" and width > _NEARLY_A_TURN
    ]
    if turns:
        return (
            f"the box lets {turns[0]} turn all the way: near its ends poses have a solution at "
            "the other end, and are often not solved; a narrower box, by --joint-box, is better"
        )
    sample = compute_random_dataset(robot, robot.joint_box, _SAMPLES, seed=0).joint_positions
    signs = branch_signs(robot, sample)
    if signs is None:
        free = len(robot.joint_box.free)
        if free > 6:
            return (
                f"{free} joints move: a pose has infinitely many solutions. Lock {free - 6} by "
                "--joint-box JOINT=VALUE"
            )
        return (
            f"{free} joints move: poses in {free} dimensions only, others are refused. Whether "
            "the box holds one branch can't be told: keep each elbow on one side"
        )
    other = min(float(np.mean(signs < 0)), float(np.mean(signs > 0)))
    if other == 0.0:
        return f"one branch: no singularity between any of {_SAMPLES} joint positions of the box"
    return (
        f"two branches or more: {100 * other:.1f} % of the working box are beyond a singularity. "
        "Poses there may have two solutions; a box without it, by --joint-box, is better"
    )


def definition_text(robot: Robot) -> str:
    """The robot's definition as YAML, which :func:`annik_core.robots.library.load_robot` reads."""
    text: str = yaml.safe_dump(dict(robot.definition), sort_keys=False)
    return text
