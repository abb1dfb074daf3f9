"""The ``annik`` command line.

What a command needs is imported when it runs: ``--help`` is quick, and ``report`` works where
torch is not installed.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from annik_core.errors import AnnikError
from annik_core.files import ensure_writable_folder, write_files_atomically
from annik_core.installation import VERSION
from annik_training.cli.options import ROBOT_OPTIONS, chosen_robot, robot_argument, robot_options

if TYPE_CHECKING:
    from annik_core.dataset import Dataset
    from annik_core.robots.robot import Robot
    from annik_training.designs.diagnostics import DesignDiagnostics
    from annik_training.evaluation import Evaluation
    from annik_training.fitting.fit import Restart
    from annik_training.train import TrainingResult

#: What to install for a library that not every command needs.
_EXTRAS = {
    "torch": "training",
    "onnxscript": "training",
    "sympy": "training",
}

_FILE = click.Path(dir_okay=False, path_type=Path)
_PATH = click.Path(path_type=Path)

_SEED = click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of all randomness."
)


#: The design and its size, by the kind of robot: the paper's for the paper's robot. Only random
#: designs fill the working box of an arm.
_DEFAULT_DESIGNS: dict[str, tuple[str, int | None]] = {
    "gantry": ("thirty_phase", None),
    "arm": ("sobol", 512),
}
_DESIGN_NAMES = (
    "thirty_phase, thirty_phase_plus, workspace_grid, central_composite, latin_hypercube, sobol, "
    "random, active or identifiability"
)


def _design_options(command: Any) -> Any:
    """Sizes and options of the designs of experiments, with the defaults of the sizes."""
    for option in reversed(
        (
            click.option(
                "--steps", type=int, help="thirty_phase(_plus): steps j of each sweep (default 6)."
            ),
            click.option(
                "--examples",
                type=int,
                help="latin_hypercube, sobol, random, active, identifiability: how many examples "
                "(default 100).",
            ),
            click.option(
                "--shells", type=int, help="central_composite: nested boxes (default 1)."
            ),
            click.option(
                "--paper-rows",
                "keep_paper_rows",
                is_flag=True,
                help="thirty_phase: the rows as the paper counts them (104, 194).",
            ),
            click.option(
                "--positions-per-axis",
                type=int,
                help="workspace_grid: positions on x, y and z (default 4).",
            ),
            click.option(
                "--orientation-levels",
                type=int,
                help="workspace_grid: fractions of roll, pitch and yaw (default 1).",
            ),
        )
    ):
        command = option(command)
    return command


#: What :func:`_fit_options` sets, by the names of the fit options; None: as suits the robot.
_FIT_FIELDS = (
    "hidden_units",
    "restarts",
    "max_evaluations",
    "held_out_fraction",
    "linear_path",
    "slope_weight",
    "bayesian_regularisation",
    "optimiser",
)


def _hidden_units(_: click.Context, __: click.Parameter, text: str | None) -> Any:
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not a list of numbers like 20,20") from error


def _fit_options(command: Any) -> Any:
    """How to fit. The defaults are those of the kind of robot."""
    for option in reversed(
        (
            click.option(
                "--hidden",
                "hidden_units",
                callback=_hidden_units,
                help="Units of the hidden layers, such as 20,20 (default 20; arm: 64,64,64).",
            ),
            click.option("--restarts", type=int, help="Random starts to fit (default 6; arm: 1)."),
            click.option(
                "--max-evaluations", type=int, help="Residuals per start (default 50; arm: 400)."
            ),
            click.option(
                "--held-out",
                "held_out_fraction",
                type=float,
                help="Part of the examples that only chooses the best start; 0: fit all of them "
                "(default 0.15; arm: 0).",
            ),
            click.option(
                "--linear-path/--no-linear-path",
                default=None,
                help="Let the inputs reach the outputs directly too (default no; arm: yes).",
            ),
            click.option(
                "--sobolev",
                "slope_weight",
                type=float,
                help="Weight of the slopes: match the Jacobian too. 0: off; 1 suits examples "
                "without noise (default 0; arm: 1).",
            ),
            click.option(
                "--bayesian/--no-bayesian",
                "bayesian_regularisation",
                default=None,
                help="Weight decay by the evidence: for few or noisy examples (default no).",
            ),
            click.option(
                "--optimiser",
                type=click.Choice(["levenberg_marquardt", "lbfgs"]),
                help="levenberg_marquardt: exact, for small networks (default); lbfgs: for "
                "thousands of weights (arm).",
            ),
        )
    ):
        command = option(command)
    return command


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="annik")
def cli() -> None:
    """Learned inverse kinematics for ROS 2, from few examples."""


@cli.command(
    help="Choose the joint positions of the examples by a design of experiments. "
    f"NAME is {_DESIGN_NAMES}; left out, thirty_phase, or for an arm sobol."
)
@click.argument("design", metavar="[NAME]", required=False)
@robot_options
@_design_options
@_SEED
@click.option(
    "--check",
    is_flag=True,
    help="Also say what the examples can and can't show, and draw a pair plot.",
)
@click.option(
    "--plot",
    type=_FILE,
    help="--check, and where the plot goes (.png), with the numbers beside it (.json). "
    "Default: DESIGN_ROBOT_pairs.png in the current folder.",
)
@click.option("--out", type=_FILE, help="Also compute the poses and save the dataset (.npz).")
def design(seed: int, check: bool, plot: Path | None, out: Path | None, **choices: Any) -> None:
    """Choose the joint positions of the examples."""
    from annik_core.dataset import save_dataset

    if plot is not None and plot.suffix != ".png":
        raise AnnikError(f"{plot} can't be written: a plot is a PNG, its name must end in .png")
    dataset = _computed_dataset(seed, choices)
    Console().print(
        escape(
            f"{dataset.design}: {len(dataset)} examples for {dataset.robot.name} "
            f"({', '.join(dataset.robot.joint_names)})"
        )
    )
    if check or plot is not None:
        _check_design(dataset, plot or Path(_file_name(dataset, "pairs.png")))
    if out is not None:
        save_dataset(dataset, out)
        Console().print(f"wrote {escape(str(out))}")


@cli.command()
@robot_options
@click.option(
    "--design",
    help=f"Design of experiments: {_DESIGN_NAMES}; default thirty_phase, or for an arm sobol with "
    "512 examples.",
)
@_design_options
@_SEED
@click.option(
    "--dataset", "dataset_path", type=_FILE, help="Train on this dataset (.npz) instead."
)
@_fit_options
@click.option("--out", type=_FILE, required=True, help="The model file to write (.onnx).")
@click.option("--summary", type=_FILE, help="Also write what came out as JSON.")
def train(
    seed: int,
    dataset_path: Path | None,
    out: Path,
    summary: Path | None,
    **choices: Any,
) -> None:
    """Train a network on few examples and write it as a model file."""
    from annik_core.dataset import load_dataset
    from annik_training.fitting.options import default_options
    from annik_training.train import train as train_model

    fit_choices = {field: choices.pop(field) for field in _FIT_FIELDS}
    changes = {field: value for field, value in fit_choices.items() if value is not None}
    if dataset_path is not None:
        _refuse_beside_dataset(*choices)
        dataset = load_dataset(dataset_path)
    else:
        dataset = _computed_dataset(seed, choices)
    options = replace(default_options(dataset.robot.kind), seed=seed, **changes)
    console = Console(stderr=True)
    with Progress(
        TextColumn("fitting {task.fields[label]}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("starts, best error {task.fields[best]}"),
        TimeElapsedColumn(),
        console=console,
    ) as progress:
        label = f"{dataset.robot.name} to {len(dataset)} examples"
        task = progress.add_task("", total=options.restarts, label=label, best="-")
        best = float("inf")

        def on_restart(restart: Restart) -> None:
            nonlocal best
            best = min(best, restart.choosing_error)
            progress.update(task, advance=1, best=f"{best:.1e}")

        result = train_model(dataset, out, options, on_restart)
    _print_training(result)
    if summary is not None:
        _write(summary, json.dumps(_training_summary(result), indent=2) + "\n")


@cli.command()
@click.option(
    "--measured",
    type=_FILE,
    required=True,
    help="Poses measured on the robot (.npz), as example_collector writes them.",
)
@click.option(
    "--nominal",
    help="The arm as described: packaged, a definition or URDF; default: the dataset's.",
)
@click.option(
    "--position-only",
    is_flag=True,
    help="The orientations were not measured: learn from the positions.",
)
@_SEED
@click.option(
    "--examples",
    type=click.IntRange(1),
    default=512,
    show_default=True,
    help="Computed examples for the network that the learned robot's answers begin at.",
)
@click.option("--out", type=_FILE, required=True, help="The model file to write (.onnx).")
@click.option("--summary", type=_FILE, help="Also write what came out as JSON.")
def fit(
    measured: Path,
    nominal: str | None,
    position_only: bool,
    seed: int,
    examples: int,
    out: Path,
    summary: Path | None,
) -> None:
    """Learn the robot you have from poses measured on it, and write its model file.

    The geometry of the links, the zeros of the joints and what their gears do are corrected, as
    far as the measured poses show it. A node answers with the corrected robot from then on, and
    the residuals that it reports are the corrected model's.
    """
    from annik_training.calibration.calibrate import learn_robot, with_nominal
    from annik_training.cli.calibration_output import learned_summary, print_learned
    from annik_training.designs.sampling import compute_dataset
    from annik_training.fitting.options import default_options
    from annik_training.train import train as train_model

    dataset = _measured_dataset(measured)
    if nominal is not None:
        dataset = with_nominal(dataset, _robot_named(nominal))
    for path in (out, *([] if summary is None else [summary])):
        ensure_writable_folder(path.parent)
    learned = learn_robot(dataset, seed, position_only=position_only)
    print_learned(learned)
    design, _ = _DEFAULT_DESIGNS["arm"]
    result = train_model(
        compute_dataset(learned.robot, design, examples, seed),
        out,
        replace(default_options("arm"), seed=seed),
    )
    _print_training(result)
    if summary is not None:
        _write(summary, json.dumps(learned_summary(learned), indent=2) + "\n")


@cli.command()
@robot_argument
@click.option("--save", type=_FILE, help="Also write the definition (.yaml): robot, frames, box.")
def robot(save: Path | None, **choices: Any) -> None:
    """Show a robot's joints, frames and working box, and whether the box holds one branch."""
    from annik_training.cli.robot_report import branch_shares, definition_text

    shown = chosen_robot(**choices)
    table = Table("joint", "type", "limits", "working box", title=escape(shown.name))
    for name, kind, *bounds in zip(
        shown.joint_names,
        shown.joint_types,
        *(
            [f"{low:.4g} .. {high:.4g}" for low, high in zip(box.lower, box.upper, strict=True)]
            for box in (shown.joint_limits, shown.joint_box)
        ),
        strict=True,
    ):
        table.add_row(escape(name), kind, *bounds)
    console = Console()
    console.print(table)
    console.print(escape(f"frames: {shown.base_frame} to {shown.end_effector_frame}; rad and m"))
    console.print(branch_shares(shown))
    if save is not None:
        _write(save, definition_text(shown))
        console.print(f"wrote {escape(str(save))}")


@cli.command()
@click.argument("model", type=_PATH)
@_SEED
@click.option(
    "--measured",
    type=_FILE,
    help="Instead of computed poses: poses measured on the robot (.npz) that a learned model was "
    "not learned from. Compares it with the nominal one.",
)
@click.option("--plot", type=_FILE, help="Draw where in the working box it is worst (.png).")
@click.option("--summary", type=_FILE, help="With --measured: also write the errors as JSON.")
def evaluate(
    model: Path, seed: int, measured: Path | None, plot: Path | None, summary: Path | None
) -> None:
    """Measure a model on fresh random poses of its robot's workspace, or on measured ones.

    MODEL is a model file or the name of a packaged model.
    """
    if measured is not None:
        _evaluate_measured(model, measured, plot, summary)
        return
    if summary is not None:
        raise AnnikError("--summary needs --measured")
    from annik_core.model.artifact import load_model
    from annik_training.cli.plots import error_map
    from annik_training.evaluation import measure, summarise
    from annik_training.train import evaluation_dataset

    artifact = load_model(model)
    errors = measure(artifact.joint_positions, evaluation_dataset(artifact.robot, seed))
    Console().print(
        _evaluation_table(summarise(errors), f"{artifact.path}: {artifact.robot.name}")
    )
    if plot is not None:
        _write(plot, error_map(errors))
        click.echo(f"wrote {plot}")


def _evaluate_measured(
    model: Path, measured: Path, plot: Path | None, summary: Path | None
) -> None:
    from annik_core.model.artifact import load_model
    from annik_training.calibration.validation import evaluate_measured
    from annik_training.cli.calibration_output import evaluation_summary, print_evaluation
    from annik_training.cli.plots import before_and_after

    artifact = load_model(model)
    evaluation = evaluate_measured(artifact.robot, _measured_dataset(measured))
    print_evaluation(evaluation, f"{artifact.path}: {artifact.robot.name}")
    if summary is not None:
        _write(summary, json.dumps(evaluation_summary(evaluation), indent=2) + "\n")
    if plot is not None:
        _write(plot, before_and_after(evaluation))
        click.echo(f"wrote {plot}")


@cli.command()
@click.argument("model", type=_PATH)
def info(model: Path) -> None:
    """Check a model and print what it says of itself.

    MODEL is a model file or the name of a packaged model.
    """
    from annik_core.model.artifact import load_model

    artifact = load_model(model)
    table = Table("entry", "value", title=escape(str(model)))
    table.add_row("sha256", artifact.sha256)
    for key, value in vars(artifact.metadata).items():
        if key not in ("robot", "reference_poses", "reference_joint_positions"):
            table.add_row(key, escape(json.dumps(value)))
    Console().print(table)


@cli.command()
@click.argument("model", type=_FILE)
@click.option("--out", type=_FILE, required=True, help="The model file to write (.onnx).")
def convert(model: Path, out: Path) -> None:
    """Convert a model file of an older format: same weights, same joint positions.

    MODEL is a model file of format 1. Nothing is trained.
    """
    from annik_training.convert import convert_model

    metadata = convert_model(model, out)
    Console().print(f"wrote {escape(str(out))} (format {metadata.format_version})")


@cli.command()
@click.argument("bag", type=_PATH)
@click.option("--out", type=_PATH, help="Folder for the report; default: report/ in the bag.")
@click.option("--namespace", help="Namespace of the robot, if the bag holds several.")
def report(bag: Path, out: Path | None, namespace: str | None) -> None:
    """Report the tracking error recorded in a bag: tables here, plots in report.html."""
    from msg_tools.report.table import print_report
    from msg_tools.report.write import write_report

    folder = out or (bag if bag.is_dir() else bag.parent) / "report"
    print_report(write_report(bag, folder, namespace))
    click.echo(f"report: {folder / 'report.html'}")


@cli.command()
def doctor() -> None:
    """Check this installation: libraries, ROS 2, models, and a target over the middleware."""
    # A process of its own: it needs ROS, of which training knows nothing.
    sys.exit(subprocess.run([sys.executable, "-m", "annik_ros.doctor"], check=False).returncode)


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


def _measured_dataset(path: Path) -> Dataset:
    """Poses that were measured; of computed ones a robot would be learned that nobody has."""
    from annik_core.dataset import COMPUTED, load_dataset
    from annik_training.calibration.errors import NotMeasured

    dataset = load_dataset(path)
    if dataset.source == COMPUTED:
        raise NotMeasured(path)
    return dataset


def _robot_named(source: str) -> Robot:
    from annik_core.robots.library import load_robot

    return load_robot(Path(source) if Path(source).suffix else source)


def _computed_dataset(seed: int, choices: dict[str, Any]) -> Dataset:
    from annik_training.designs.registry import find_design
    from annik_training.designs.sampling import compute_dataset

    robot = chosen_robot(**{name: choices.pop(name) for name in ROBOT_OPTIONS})
    named = choices.pop("design")
    usual, usual_size = _DEFAULT_DESIGNS[robot.kind]
    chosen = find_design(named or usual)
    # By identity: 0 equals False, but was given, and must be refused where it makes no sense.
    given = {
        option: value
        for option, value in choices.items()
        if value is not None and value is not False
    }
    size = given.pop(chosen.size_option, None)
    if size is not None:
        used = size
    elif named is None and usual_size is not None:
        used = usual_size
    else:
        used = chosen.default_size
    dataset = compute_dataset(robot, chosen.name, used, seed, given)
    if size is None:
        Console().print(f"{chosen.name}: {chosen.size_flag} is {used}, the default")
    return dataset


def _check_design(dataset: Dataset, plot: Path) -> None:
    """Say what the examples can and can't show: in the terminal, in a picture, in figures."""
    from annik_training.designs.diagnostics import diagnose
    from annik_training.designs.plot import pair_plot

    robot = dataset.robot
    diagnostics = diagnose(dataset.joint_positions, robot.joint_box)
    _print_diagnostics(diagnostics)
    title = f"{dataset.design}: {len(dataset)} examples for {robot.name}"
    picture = pair_plot(
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
    _write(plot, picture)
    _write(beside, json.dumps(numbers, indent=2) + "\n")
    click.echo(f"wrote {plot} and {beside}")


def _file_name(dataset: Dataset, what: str) -> str:
    """A name for what was made of a dataset; a robot may be called anything."""
    return "_".join(
        re.sub(r"[^\w.-]", "-", part) for part in (dataset.design, dataset.robot.name, what)
    )


def _print_diagnostics(diagnostics: DesignDiagnostics) -> None:
    table = Table("model in the joint positions", "rank", "terms", "condition number")
    for name, model in (("linear", diagnostics.linear), ("quadratic", diagnostics.quadratic)):
        table.add_row(name, str(model.rank), str(model.terms), f"{model.condition:.1f}")
    console = Console()
    console.print(table)
    # Without spaces, so that no line ends within a product.
    blind = ", ".join(f"{first}*{second}" for first, second in diagnostics.blind_interactions)
    console.print(f"interactions it can't tell apart: {escape(blind) or 'none'}")
    console.print(
        f"largest empty ball: {diagnostics.largest_empty_ball:.2f} of half the box's diagonal"
    )


def _print_training(result: TrainingResult) -> None:
    fitted = result.fitted
    left_out = f", {fitted.second_solutions} second solutions left out"
    Console().print(
        f"{len(fitted.dataset)} examples ({len(fitted.held_out)} held out to choose among "
        f"{len(fitted.restarts)} starts{left_out if fitted.second_solutions else ''}), "
        f"{fitted.seconds:.1f} s"
    )
    Console().print(_evaluation_table(result.evaluation, str(result.path)))
    _warn_of_refusals(result.evaluation)


def _warn_of_refusals(evaluation: Evaluation) -> None:
    """Say it if a node would often refuse what the model answers."""
    from annik_core.safety import AcceptanceLimits

    limits = AcceptanceLimits()
    refined = evaluation.refined
    if refined is not None:
        if refined.success < 0.95:
            click.echo(
                f"annik: of {100 * (1 - refined.success):.1f} % of these poses the solution was "
                "not found; give more --examples, or a smaller working box: annik robot shows it",
                err=True,
            )
    elif (
        evaluation.position_error.p95 > limits.max_position_residual
        or evaluation.orientation_error.p95 > limits.max_orientation_residual
    ):
        click.echo(
            "annik: more than 5 % of these poses are beyond what ik_node accepts by default "
            f"({1e3 * limits.max_position_residual:g} mm, "
            f"{limits.max_orientation_residual:g} rad) and would be refused; give more --examples "
            "or --steps, --restarts or --max-evaluations, or another --design",
            err=True,
        )


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
    refined = evaluation.refined
    if refined is not None:
        table.caption = (
            f"{evaluation.examples} random poses, the network alone. Refined: "
            f"{100 * refined.success:.2f} % solved inside the working box, at most "
            f"{1e9 * refined.position_residual:.0f} nm off; steps {refined.mean_steps:.1f} on "
            f"average, {refined.p99_steps:.0f} p99, {refined.max_steps} at most; "
            f"{100 * refined.same_solution:.2f} % by the joint positions the pose was made from"
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
        "second_solutions": fitted.second_solutions,
        "seconds": fitted.seconds,
        "seed": fitted.options.seed,
        "winning_restart": fitted.winner,
        "restarts": [vars(restart) for restart in fitted.restarts],
        "evaluation": result.evaluation.as_plain_data(),
    }


def _write(path: Path, content: str | bytes) -> None:
    data = content.encode() if isinstance(content, str) else content
    ensure_writable_folder(path.parent)
    write_files_atomically(path.parent, {path.name: data})


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
