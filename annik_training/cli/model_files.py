"""``annik info`` and ``export-urdf``: look into a model file, or write from it."""

import json
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.files import write_file
from annik_core.model.artifact import load_model
from annik_core.robots.description import robot_urdf
from annik_training.calibration.errors import NotCalibrated
from annik_training.cli.options import FILE, PATH

_LONG = ("robot", "reference_poses", "reference_joint_positions")


@click.command()
@click.argument("model", type=PATH)
def info(model: Path) -> None:
    """Check a model file and print its metadata.

    MODEL is a model file or the name of a packaged model.
    """
    loaded = load_model(model)
    table = Table("entry", "value", title=escape(str(model)))
    table.add_row("sha256", loaded.sha256)
    table.add_row("quality", escape(str(loaded.quality)))
    for key, value in vars(loaded.metadata).items():
        if key not in _LONG:
            table.add_row(key, escape(json.dumps(value)))
    Console().print(table)


@click.command()
@click.argument("model", type=PATH)
@click.option("--out", type=FILE, help="The file to write (.urdf); by default it is printed.")
@click.option(
    "--calibrated",
    is_flag=True,
    help="With the geometric part of a calibration; a comment says how much that leaves out.",
)
def export_urdf(model: Path, out: Path | None, calibrated: bool) -> None:
    """Write the URDF of a model's robot, for RViz and robot_state_publisher.

    MODEL is a model file or the name of a packaged model. The robot is drawn as sticks, and is as
    described: without the corrections of a calibration, unless --calibrated asks for them.
    """
    robot = load_model(model).robot
    if calibrated and "corrections" not in robot.definition:
        raise NotCalibrated(robot.name)
    if calibrated:
        # Not above: it loads slowly.
        from annik_core.robots.calibrated_urdf import calibrated_urdf

        urdf = calibrated_urdf(robot)
    else:
        urdf = robot_urdf(robot)
    if out is None:
        click.echo(urdf)
    else:
        write_file(out, f"{urdf.rstrip()}\n")
        click.echo(f"wrote {out}")
