"""The ``annik`` command line.

What a command needs is imported when it runs: ``--help`` is quick, and ``report`` works where
torch is not installed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from annik_core.atomic_write import write_files_atomically
from annik_core.errors import AnnikError, DesignError
from annik_core.version import VERSION

if TYPE_CHECKING:
    from annik_training.dataset import Dataset
    from annik_training.design_diagnostics import DesignDiagnostics
    from annik_training.evaluation import Evaluation
    from annik_training.fit import Restart
    from annik_training.train import TrainingResult

#: What to install for a library that not every command needs.
_EXTRAS = {"torch": "training", "onnxscript": "training", "sympy": "training"}

_FILE = click.Path(dir_okay=False, path_type=Path)
_PATH = click.Path(path_type=Path)

_ROBOT = click.option(
    "--robot", default="gantry", show_default=True, help="Packaged robot, or a definition (.yaml)."
)
_SEED = click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of all randomness."
)


def _design_options(command: Any) -> Any:
    for option in reversed(
        (
            click.option(
                "--design",
                default="thirty_phase",
                show_default=True,
                help="Design of experiments: thirty_phase, thirty_phase_plus, workspace_grid, "
                "latin_hypercube, sobol or random.",
            ),
            click.option("--steps", type=int, help="thirty_phase(_plus): steps j of each sweep."),
            click.option(
                "--examples", type=int, help="latin_hypercube, sobol, random: how many examples."
            ),
            click.option(
                "--paper-rows",
                "keep_paper_rows",
                is_flag=True,
                help="thirty_phase: the rows as the paper counts them (104, 194).",
            ),
            click.option(
                "--positions-per-axis", type=int, help="workspace_grid: positions on x, y and z."
            ),
            click.option(
                "--orientation-levels",
                type=int,
                help="workspace_grid: fractions of roll, pitch and yaw.",
            ),
        )
    ):
        command = option(command)
    return command


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="annik")
def cli() -> None:
    """Learned inverse kinematics for ROS 2, from few examples."""


@cli.command()
@_ROBOT
@_design_options
@_SEED
@click.option("--check", is_flag=True, help="Also say what the examples can and can't show.")
@click.option("--out", type=_FILE, help="Also compute the poses and save the dataset (.npz).")
def design(robot: str, seed: int, check: bool, out: Path | None, **choices: Any) -> None:
    """Choose the joint positions of the examples."""
    from annik_training.dataset import save_dataset
    from annik_training.design_diagnostics import diagnose

    dataset = _computed_dataset(robot, seed, choices)
    Console().print(
        escape(
            f"{dataset.design}: {len(dataset)} examples for {dataset.robot.name} "
            f"({', '.join(dataset.robot.joint_names)})"
        )
    )
    if check:
        _print_diagnostics(diagnose(dataset.joint_positions, dataset.robot.joint_box))
    if out is not None:
        save_dataset(dataset, out)
        Console().print(f"wrote {escape(str(out))}")


@cli.command()
@_ROBOT
@_design_options
@_SEED
@click.option(
    "--dataset", "dataset_path", type=_FILE, help="Train on this dataset (.npz) instead."
)
@click.option(
    "--hidden", default="20", show_default=True, help="Units of the hidden layers, such as 20,20."
)
@click.option("--restarts", type=int, default=6, show_default=True, help="Random starts to fit.")
@click.option(
    "--max-evaluations", type=int, default=50, show_default=True, help="Residuals per start."
)
@click.option("--out", type=_FILE, required=True, help="The model file to write (.onnx).")
@click.option("--summary", type=_FILE, help="Also write what came out as JSON.")
def train(
    robot: str,
    seed: int,
    dataset_path: Path | None,
    hidden: str,
    restarts: int,
    max_evaluations: int,
    out: Path,
    summary: Path | None,
    **choices: Any,
) -> None:
    """Train a network on few examples and write it as a model file."""
    from annik_training.dataset import load_dataset
    from annik_training.fit import FitOptions
    from annik_training.train import train as train_model

    options = FitOptions(
        hidden_units=_hidden_units(hidden),
        restarts=restarts,
        max_evaluations=max_evaluations,
        seed=seed,
    )
    if dataset_path is not None:
        _refuse_beside_dataset("robot", *choices)
        dataset = load_dataset(dataset_path)
    else:
        dataset = _computed_dataset(robot, seed, choices)
    console = Console(stderr=True)
    with Progress(
        TextColumn("fitting {task.fields[label]}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("starts, best held-out error {task.fields[best]}"),
        TimeElapsedColumn(),
        console=console,
    ) as progress:
        label = f"{dataset.robot.name} to {len(dataset)} examples"
        task = progress.add_task("", total=restarts, label=label, best="-")
        best = float("inf")

        def on_restart(restart: Restart) -> None:
            nonlocal best
            best = min(best, restart.held_out_error)
            progress.update(task, advance=1, best=f"{best:.1e}")

        result = train_model(dataset, out, options, on_restart)
    _print_training(result)
    if summary is not None:
        _write(summary, json.dumps(_training_summary(result), indent=2) + "\n")


@cli.command()
@click.argument("model", type=_FILE)
@_SEED
def evaluate(model: Path, seed: int) -> None:
    """Measure a model file on fresh random poses of its robot's workspace."""
    from annik_core.artifact import load_artifact
    from annik_training.evaluation import evaluate as evaluate_network
    from annik_training.train import evaluation_dataset

    artifact = load_artifact(model)
    evaluation = evaluate_network(
        artifact.joint_positions, evaluation_dataset(artifact.robot, seed)
    )
    Console().print(_evaluation_table(evaluation, f"{model}: {artifact.robot.name}"))


@cli.command()
@click.argument("model", type=_FILE)
def info(model: Path) -> None:
    """Check a model file and print what it says of itself."""
    from annik_core.artifact import load_artifact

    artifact = load_artifact(model)
    table = Table("entry", "value", title=escape(str(model)))
    table.add_row("sha256", artifact.sha256)
    for key, value in vars(artifact.metadata).items():
        if key not in ("robot", "reference_poses", "reference_joint_positions"):
            table.add_row(key, escape(json.dumps(value)))
    Console().print(table)


@cli.command()
@click.argument("bag", type=_PATH)
@click.option("--out", type=_PATH, help="Folder for the report; default: report/ in the bag.")
@click.option("--namespace", help="Namespace of the robot, if the bag holds several.")
def report(bag: Path, out: Path | None, namespace: str | None) -> None:
    """Report the tracking error recorded in a bag: tables here, plots in report.html."""
    from msg_tools.report import write_report
    from msg_tools.report_table import print_report

    folder = out or (bag if bag.is_dir() else bag.parent) / "report"
    print_report(write_report(bag, folder, namespace))
    click.echo(f"report: {folder / 'report.html'}")


class ConflictingOptions(AnnikError):
    """Options were given together of which one makes the others meaningless."""

    def __init__(self, option: str, others: Sequence[str]) -> None:
        self.option = option
        self.others = tuple(others)
        super().__init__(f"{option} can't be used together with {', '.join(self.others)}")


class MissingLibrary(AnnikError):
    """A library that this command needs is not installed."""

    def __init__(self, library: str, extra: str) -> None:
        self.library = library
        super().__init__(f"this needs {library}: install it with pip install '.[{extra}]'")


def _refuse_beside_dataset(*names: str) -> None:
    """Refuse options that say how to make examples: those of the dataset are made."""
    context = click.get_current_context()
    flags = {parameter.name: parameter.opts[0] for parameter in context.command.params}
    given = [
        flags[name]
        for name in names
        if context.get_parameter_source(name) is not ParameterSource.DEFAULT
    ]
    if given:
        raise ConflictingOptions("--dataset", given)


def _computed_dataset(robot_name: str, seed: int, choices: dict[str, Any]) -> Dataset:
    from annik_core.robot_library import load_robot
    from annik_training.dataset import compute_dataset
    from annik_training.design_registry import find_design

    chosen = find_design(choices.pop("design"))
    # By identity: 0 equals False, but was given, and must be refused where it makes no sense.
    given = {
        option: value
        for option, value in choices.items()
        if value is not None and value is not False
    }
    size = given.pop(chosen.size_option, None)
    if size is None:
        flag = chosen.size_option.replace("_", "-")
        raise DesignError(f"design {chosen.name} needs --{flag}: {chosen.size_means}")
    return compute_dataset(load_robot(robot_name), chosen.name, size, seed, given)


def _print_diagnostics(diagnostics: DesignDiagnostics) -> None:
    table = Table("model in the joint positions", "rank", "terms", "condition number")
    for name, model in (("linear", diagnostics.linear), ("quadratic", diagnostics.quadratic)):
        table.add_row(name, str(model.rank), str(model.terms), f"{model.condition:.1f}")
    console = Console()
    console.print(table)
    blind = ", ".join(f"{first} x {second}" for first, second in diagnostics.blind_interactions)
    console.print(f"interactions it can't tell apart: {blind or 'none'}")
    console.print(
        f"largest empty ball: {diagnostics.largest_empty_ball:.2f} of half the box's diagonal"
    )


def _hidden_units(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not a list of numbers like 20,20") from error


def _print_training(result: TrainingResult) -> None:
    fitted = result.fitted
    Console().print(
        f"{len(fitted.dataset)} examples ({len(fitted.held_out)} held out to choose among "
        f"{len(fitted.restarts)} starts), {fitted.seconds:.1f} s"
    )
    Console().print(_evaluation_table(result.evaluation, str(result.path)))


def _evaluation_table(evaluation: Evaluation, title: str) -> Table:
    import numpy as np

    position, orientation = evaluation.position_error, evaluation.orientation_error
    columns = ("rms", "p50", "p95", "p99", "max")
    # Escaped, as a unit in brackets is markup to rich, and a file may be called anything.
    table = Table(
        "error", *columns, title=escape(title), caption=f"{evaluation.examples} random poses"
    )
    table.add_row(
        escape("position [mm]"), *(f"{1e3 * getattr(position, column):.5f}" for column in columns)
    )
    table.add_row(
        escape("orientation [deg]"),
        *(f"{np.degrees(getattr(orientation, column)):.6f}" for column in columns),
    )
    return table


def _training_summary(result: TrainingResult) -> dict[str, Any]:
    fitted = result.fitted
    return {
        "model": str(result.path),
        "robot": fitted.dataset.robot.name,
        "design": fitted.dataset.design,
        "design_options": dict(fitted.dataset.design_options),
        "examples": len(fitted.dataset),
        "held_out_examples": len(fitted.held_out),
        "seconds": fitted.seconds,
        "seed": fitted.options.seed,
        "winning_restart": fitted.winner,
        "restarts": [vars(restart) for restart in fitted.restarts],
        "evaluation": result.evaluation.as_plain_data(),
    }


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_files_atomically(path.parent, {path.name: text.encode()})
    except OSError as error:
        raise AnnikError(f"{path} can't be written: {error.strerror}") from error


def main() -> None:
    """Run the command line; a fault that annik knows is one line and exit code 1."""
    try:
        _run()
    except AnnikError as error:
        # The parsers whose complaints some errors quote write several lines.
        click.echo(f"annik: {' '.join(str(error).split())}", err=True)
        sys.exit(1)


def _run() -> None:
    try:
        cli(standalone_mode=True)
    except ModuleNotFoundError as error:
        library = (error.name or "").partition(".")[0]
        if library not in _EXTRAS:
            raise
        raise MissingLibrary(library, _EXTRAS[library]) from error


if __name__ == "__main__":
    main()
