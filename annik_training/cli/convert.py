"""``annik convert``: write a model file of an older format in today's."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from annik_training.cli.options import FILE
from annik_training.convert import convert_model


@click.command()
@click.argument("model", type=FILE)
@click.option("--out", type=FILE, required=True, help="The model file to write (.onnx).")
def convert(model: Path, out: Path) -> None:
    """Convert a model file of an older format: same weights, same joint positions.

    MODEL is a model file of format 1. Nothing is trained.
    """
    metadata = convert_model(model, out)
    Console().print(f"wrote {escape(str(out))} (format {metadata.format_version})")
