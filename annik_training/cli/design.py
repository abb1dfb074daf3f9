"""``annik design``: the joint positions of the examples, and what they can show."""

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from annik_core.dataset import Dataset, save_dataset
from annik_core.errors import InvalidValue
from annik_core.files import write_file
from annik_training.cli.options import (
    DEFAULT_DESIGN,
    DESIGN_NAMES,
    FILE,
    SEED,
    chosen_dataset,
    design_options,
    robot_options,
)


@click.command(
    help="Choose the joint positions of the examples by a design of experiments.\n\n"
    f"NAME is {DESIGN_NAMES} (default {DEFAULT_DESIGN})."
)
@click.argument("design", metavar="[NAME]", required=False)
@robot_options
@design_options
@SEED
@click.option(
    "--check", is_flag=True, help="Also print diagnostics of the design, and draw a pair plot."
)
@click.option(
    "--plot",
    type=FILE,
    help="--check, with the path of the plot (.png); the numbers are beside it (.json). "
    "Default: DESIGN_ROBOT_pairs.png in the current folder.",
)
@click.option("--view", is_flag=True, help="Also show the poses that it reaches in the browser.")
@click.option("--out", type=FILE, help="Also compute the poses and save the dataset (.npz).")
def design(
    seed: int, check: bool, plot: Path | None, view: bool, out: Path | None, **choices: Any
) -> None:
    """Choose the joint positions of the examples."""
    if plot is not None and plot.suffix != ".png":
        raise InvalidValue("--plot", str(plot), "a name that ends in .png")
    dataset = chosen_dataset(seed, choices)
    click.echo(
        f"{dataset.design}: {len(dataset)} examples for {dataset.robot.name} "
        f"({', '.join(dataset.robot.joint_names)})"
    )
    if check or plot is not None:
        _check_design(dataset, plot or Path(_plot_name(dataset)))
    if out is not None:
        save_dataset(dataset, out)
        click.echo(f"wrote {out}")
    if view:
        from annik_training.cli.view import show_page
        from annik_view.solvers import solver_for
        from annik_view.state import Examples, ViewState

        examples = Examples(dataset.joint_positions, dataset.poses[:, :3])
        show_page(ViewState(solver_for(dataset.robot), examples=examples))


def _check_design(dataset: Dataset, plot: Path) -> None:
    """Print diagnostics, and write them beside the pair plot."""
    from annik_training.cli.plots import png
    from annik_training.designs.diagnostics import diagnose
    from annik_training.designs.plot import pair_figure

    robot = dataset.robot
    diagnostics = diagnose(dataset.joint_positions, robot.joint_box)
    click.echo(diagnostics)
    blind = ", ".join(f"{first}*{second}" for first, second in diagnostics.blind_interactions)
    click.echo(f"interactions it can't tell apart: {blind or 'none'}")
    title = f"{dataset.design}: {len(dataset)} examples for {robot.name}"
    figure = pair_figure(
        dataset.joint_positions, robot.joint_box, robot.joint_types, diagnostics, title
    )
    numbers = {
        "robot": robot.name,
        "design": dataset.design,
        "design_options": dict(dataset.design_options),
        "seed": dataset.seed,
        **asdict(diagnostics),
    }
    beside = plot.with_suffix(".json")
    write_file(plot, png(figure))
    write_file(beside, json.dumps(numbers, indent=2) + "\n")
    click.echo(f"wrote {plot} and {beside}")


def _plot_name(dataset: Dataset) -> str:
    """A file name; the name of a robot may have any characters."""
    parts = (dataset.design, dataset.robot.name, "pairs.png")
    return "_".join(re.sub(r"[^\w.-]", "-", part) for part in parts)
