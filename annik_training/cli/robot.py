"""``annik robot``: joints, frames, joint box and branches of a robot, before training."""

from pathlib import Path
from typing import Any

import click
import yaml
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.files import write_file
from annik_core.robots.calibrated_urdf import with_ur_calibration
from annik_core.robots.definition import number_text
from annik_core.robots.urdf_joint import CONTINUOUS_LIMIT
from annik_training.cli.options import FILE, PATH, chosen_robot, robot_argument
from annik_training.joint_box import findings


@click.command()
@robot_argument
@click.option("--save", type=FILE, help="Also write the definition (.yaml): robot, frames, box.")
@click.option(
    "--ur-calibration",
    type=PATH,
    help="Of an arm of Universal Robots: its factory calibration, the kinematics file (.yaml) of "
    "ur_calibration.",
)
def robot(save: Path | None, ur_calibration: Path | None, **choices: Any) -> None:
    """Show a robot's joints, frames and joint box, and the branches in the box."""
    shown = chosen_robot(choices)
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


def _interval(lower: float, upper: float) -> str:
    """As --joint-box takes it."""
    if upper == CONTINUOUS_LIMIT:
        return "none"
    bounds = (lower,) if lower == upper else (lower, upper)
    return ":".join(map(number_text, bounds))
