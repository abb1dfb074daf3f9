"""``annik info``: check a model file and print its metadata."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from annik_core.model.artifact import load_model
from annik_training.cli.options import PATH

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
    for key, value in vars(loaded.metadata).items():
        if key not in _LONG:
            table.add_row(key, escape(json.dumps(value)))
    Console().print(table)
