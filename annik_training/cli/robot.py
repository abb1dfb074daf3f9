"""``annik robot``: joints, frames, joint box and branches of a robot, before training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
import yaml
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.files import write_file
from annik_core.robots.robot import Robot
from annik_core.robots.urdf_joint import CONTINUOUS_LIMIT
from annik_training.cli.options import FILE, chosen_robot, robot_argument
from annik_training.designs.sampling import random_dataset
from annik_training.fitting.branches import branch_signs, has_branches

_SAMPLES = 5000
#: From this width on, both ends of a joint's interval are nearly the same position [rad].
_NEARLY_A_TURN = 2.0 * np.pi - 0.2


@click.command()
@robot_argument
@click.option("--save", type=FILE, help="Also write the definition (.yaml): robot, frames, box.")
def robot(save: Path | None, **choices: Any) -> None:
    """Show a robot's joints, frames and joint box, and the branches in the box."""
    shown = chosen_robot(choices)
    table = Table("joint", "type", "limits", "joint box", title=escape(shown.name))
    for name, kind, *bounds in zip(
        shown.joint_names,
        shown.joint_types,
        *(
            [
                "none" if high == CONTINUOUS_LIMIT else f"{low:.4g} .. {high:.4g}"
                for low, high in zip(box.lower, box.upper, strict=True)
            ]
            for box in (shown.joint_limits, shown.joint_box)
        ),
        strict=True,
    ):
        table.add_row(escape(name), kind, *bounds)
    console = Console()
    console.print(table)
    console.print(escape(f"frames: {shown.base_frame} to {shown.end_effector_frame}; rad and m"))
    console.print(_branches(shown))
    if save is not None:
        text: str = yaml.safe_dump(dict(shown.definition), sort_keys=False)
        write_file(save, text)
        console.print(f"wrote {escape(str(save))}")


def _branches(robot: Robot) -> str:
    """One line on how much of the joint box lies on which side of a singularity."""
    if not has_branches(robot):
        return "one branch: every pose of the workspace has one solution"
    widths = robot.joint_box.upper - robot.joint_box.lower
    for name, kind, width in zip(robot.joint_names, robot.joint_types, widths, strict=True):
        if kind == "revolute" and width > _NEARLY_A_TURN:
            return (
                f"the box of {name} is a full turn: poses near its ends have a second solution at "
                "the other end, and are often not solved; a smaller box, by --joint-box, is better"
            )
    sample = random_dataset(robot, robot.joint_box, _SAMPLES, seed=0).joint_positions
    signs = branch_signs(robot, sample)
    if signs is None:
        free = len(robot.joint_box.free)
        if free > 6:
            return (
                f"{free} joints move: a pose has infinitely many solutions. Lock {free - 6} by "
                "--joint-box JOINT=VALUE"
            )
        return (
            f"{free} joints move: poses in {free} dimensions only, others are refused. The number "
            "of branches is unknown: keep each elbow on one side"
        )
    other = min(float(np.mean(signs < 0)), float(np.mean(signs > 0)))
    if other == 0.0:
        return f"one branch: no singularity between any of {_SAMPLES} joint positions of the box"
    return (
        f"two branches or more: {100 * other:.1f} % of the joint box are beyond a singularity. "
        "Poses there may have two solutions; a box without it, by --joint-box, is better"
    )
