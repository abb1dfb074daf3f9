"""``annik robot``: joints, frames, joint box and branches of a robot, before training."""

import shlex
from pathlib import Path
from typing import Any

import click
import numpy as np
import yaml
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.errors import AnnikError, InvalidValue
from annik_core.files import write_file
from annik_core.pose import FloatArray
from annik_core.robots.calibrated_urdf import with_ur_calibration
from annik_core.robots.definition import number_text
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_core.robots.urdf_joint import CONTINUOUS_LIMIT
from annik_training.cli.options import FILE, PATH, chosen_robot, robot_argument
from annik_training.joint_box import findings
from annik_training.suggested_box import suggested_box


@click.command()
@robot_argument
@click.option("--save", type=FILE, help="Also write the definition (.yaml): robot, frames, box.")
@click.option(
    "--ur-calibration",
    type=PATH,
    help="Of an arm of Universal Robots: its factory calibration, the kinematics file (.yaml) of "
    "ur_calibration.",
)
@click.option(
    "--suggest-box",
    is_flag=True,
    help="Print the largest joint box on one branch that a search finds, as options to paste.",
)
@click.option(
    "--around",
    multiple=True,
    metavar="JOINT=VALUE",
    help="Joint positions [rad or m] in the suggested box, in the middle of the limits unless "
    "given; without any, those farthest from a singularity.",
)
def robot(
    save: Path | None,
    ur_calibration: Path | None,
    suggest_box: bool,
    around: tuple[str, ...],
    **choices: Any,
) -> None:
    """Show a robot's joints, frames and joint box, and the branches in the box."""
    shown = chosen_robot(choices)
    if around and not suggest_box:
        raise AnnikError("--around needs --suggest-box")
    if ur_calibration is not None:
        shown = with_ur_calibration(shown, ur_calibration)
    title = escape(f"{shown.name}: LOWER:UPPER in rad and m")
    table = Table("joint", "type", "limits", "joint box", title=title)
    limits, box = (
        map(_interval, bounds.lower.tolist(), bounds.upper.tolist())
        for bounds in (shown.joint_limits, shown.joint_box)
    )
    for name, *row in zip(shown.joint_names, shown.joint_types, limits, box, strict=True):
        table.add_row(escape(name), *row)
    # Numbers that are cut or wrapped can't be copied.
    Console(width=10_000).print(table)
    click.echo(f"frames: {shown.base_frame} to {shown.end_effector_frame}")
    click.echo("\n".join(findings(shown)))
    if save is not None:
        text: str = yaml.safe_dump(dict(shown.definition), sort_keys=False)
        write_file(save, text)
        click.echo(f"wrote {save}")

    if suggest_box:
        click.echo(box_options(suggested_box(shown, joint_positions_of(shown, around))))


def joint_positions_of(robot: Robot, given: tuple[str, ...]) -> FloatArray | None:
    """Joint positions ``(dof,)`` from texts ``JOINT=VALUE``; None without any."""
    if not given:
        return None
    positions = robot.joint_box.centre
    for text in given:
        joint, _, value = text.rpartition("=")
        try:
            positions[robot.joint_names.index(joint)] = float(value)
        except ValueError as error:
            allowed = f"JOINT=VALUE [rad or m], of {', '.join(robot.joint_names)}"
            raise InvalidValue("--around", text, allowed) from error
    return positions


def box_options(box: JointLimits) -> str:
    """A joint box as options to paste; numbers are rounded inwards."""
    # Zero is added because ceil gives -0.
    rounded = np.ceil(box.lower * 1e3) / 1e3 + 0.0, np.floor(box.upper * 1e3) / 1e3 + 0.0
    return " ".join(
        f"--joint-box {shlex.quote(name)}={_interval(min(low, high), high)}"
        for name, low, high in zip(box.joint_names, *map(list, rounded), strict=True)
    )


def _interval(lower: float, upper: float) -> str:
    """As --joint-box takes it."""
    if upper == CONTINUOUS_LIMIT:
        return "none"
    bounds = (lower,) if lower == upper else (lower, upper)
    return ":".join(map(number_text, bounds))
