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
def export_urdf(model: Path, out: Path | None) -> None:
    """Write the URDF of a model's robot, for RViz and robot_state_publisher.

    MODEL is a model file or the name of a packaged model. The robot is drawn as sticks, and is as
    described: without the corrections of a calibration.
    """
    urdf = robot_urdf(load_model(model).robot)
    if out is None:
        click.echo(urdf)
    else:
        write_file(out, f"{urdf}\n")
        click.echo(f"wrote {out}")
