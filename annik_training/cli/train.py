"""``annik train``: from a robot or a dataset to a model file."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

import annik_training
from annik_core.dataset import load_dataset
from annik_core.errors import AnnikError
from annik_core.files import write_file
from annik_training.cli.options import (
    DEFAULT_DESIGN,
    DESIGN_NAMES,
    EVALUATION_POSES,
    FILE,
    FIT_NAMES,
    SEED,
    SUMMARY,
    chosen_dataset,
    chosen_fit,
    design_options,
    fit_options,
    robot_options,
)
from annik_training.cli.output import print_training
from annik_training.joint_box import findings

if TYPE_CHECKING:
    from annik_training import TrainedModel
    from annik_training.fitting.fit import Restart


class ConflictingOptions(AnnikError):
    """An option makes others meaningless that were given with it."""

    def __init__(self, option: str, others: Sequence[str]) -> None:
        self.option = option
        self.others = tuple(others)
        super().__init__(f"{option} can't be used together with {', '.join(self.others)}")


@click.command()
@robot_options
@click.option(
    "--design", help=f"Design of experiments: {DESIGN_NAMES} (default {DEFAULT_DESIGN})."
)
@design_options
@SEED
@click.option("--dataset", "dataset_path", type=FILE, help="Train on this dataset (.npz) instead.")
@fit_options
@EVALUATION_POSES
@click.option("--out", type=FILE, required=True, help="The model file to write (.onnx).")
@SUMMARY
def train(
    seed: int,
    dataset_path: Path | None,
    evaluation_poses: int,
    out: Path,
    summary: Path | None,
    **choices: Any,
) -> None:
    """Train a network on few examples and write it as a model file."""
    fit_choices = {name: choices.pop(name) for name in FIT_NAMES}
    if dataset_path is not None:
        _refuse_beside_dataset(*choices)
        dataset = load_dataset(dataset_path)
    else:
        dataset = chosen_dataset(seed, choices)
    options = chosen_fit(dataset.robot, seed, fit_choices)
    # Loaded before the progress bar appears: torch may be missing.
    train_model = annik_training.train
    click.echo("\n".join(findings(dataset.robot)), err=True)
    with Progress(
        TextColumn("fitting {task.fields[label]}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("restarts, best error {task.fields[best]}"),
        TimeElapsedColumn(),
        console=Console(stderr=True),
    ) as progress:
        label = f"{dataset.robot.name} to {len(dataset)} examples"
        task = progress.add_task("", total=options.restarts, label=label, best="-")
        best = float("inf")

        def on_restart(restart: "Restart") -> None:
            nonlocal best
            best = min(best, restart.choosing_error)
            progress.update(task, advance=1, best=f"{best:.1e}")

        trained = train_model(
            dataset, out, options, evaluation_poses=evaluation_poses, on_restart=on_restart
        )
    print_training(trained)
    if summary is not None:
        write_file(summary, json.dumps(_summary(trained), indent=2) + "\n")


def _refuse_beside_dataset(*names: str) -> None:
    """Refuse options that say how to make examples: the dataset has its own."""
    context = click.get_current_context()
    flags = {parameter.name: parameter.opts[0] for parameter in context.command.params}
    given = [
        flags[name]
        for name in names
        if context.get_parameter_source(name) is not ParameterSource.DEFAULT
    ]
    if given:
        raise ConflictingOptions("--dataset", given)


def _summary(trained: "TrainedModel") -> dict[str, Any]:
    fitted = trained.fitted
    return {
        "model": str(trained.path),
        "robot": fitted.dataset.robot.name,
        "design": fitted.dataset.design,
        "design_options": dict(fitted.dataset.design_options),
        "examples": len(fitted.dataset),
        "held_out_examples": len(fitted.held_out),
        "second_solutions": fitted.second_solutions,
        "seconds": fitted.seconds,
        "seed": fitted.options.seed,
        "winning_restart": fitted.winner,
        "restarts": [restart.to_dict() for restart in fitted.restarts],
        "evaluation": trained.evaluation.to_dict(),
    }
