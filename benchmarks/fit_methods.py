"""Separable Levenberg-Marquardt against the plain one, on the paper's robot and sets of examples.

Both start from the same random weights, get the same examples (all of them: nothing is held out,
and nothing chooses among the starts) and are stopped after the same number of evaluations. Errors
are measured on 2,000 random poses of the workspace and on the 15 points of the paper's path.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import torch
from rich.progress import track
from scipy.optimize import least_squares
from torch import Tensor
from torch.func import functional_call, jacrev, vmap

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.target_paths import diagonal_path
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.fitting.fit import (
    dataset_examples,
    fit_restart,
    scaled_examples,
    untrained_network,
)
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem
from annik_training.fitting.variable_projection import ScaledExamples
from annik_training.networks.network import InverseKinematicsNetwork, ScaledNetwork
from benchmarks.command_line import (
    chosen,
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    quick_option,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table

SETS = {"Set 1": 3, "Set 2": 6, "Set 3": 15}
METHODS = ("separable", "plain")


@dataclass(frozen=True)
class _Settings:
    starts: int = 10
    evaluations: int = FitOptions.max_evaluations


_STANDARD, _QUICK = _Settings(), _Settings(starts=2, evaluations=5)


@dataclass(frozen=True)
class Outcome:
    """One start: mean square error in scaled units, position errors in mm, time in seconds."""

    training_error: float
    workspace_rms: float
    workspace_max: float
    path_max: float
    seconds: float


def fit_plain(network: ScaledNetwork, examples: ScaledExamples, max_evaluations: int) -> float:
    """Levenberg-Marquardt on all weights at once; returns the mean square error."""
    inputs, targets = examples.inputs, examples.targets
    layers = torch.nn.Sequential(network.hidden, network.output)
    with torch.no_grad():
        # The separable fit has no start values for these; zero is the neutral choice.
        network.output.weight.zero_()
        network.output.bias.zero_()
    shapes = {name: value.shape for name, value in layers.named_parameters()}
    sizes = [shape.numel() for shape in shapes.values()]

    def named(weights: FloatArray) -> dict[str, Tensor]:
        parts = torch.split(torch.from_numpy(weights), sizes)
        return {n: p.reshape(s) for (n, s), p in zip(shapes.items(), parts, strict=True)}

    def output(weights: dict[str, Tensor], example: Tensor) -> Tensor:
        found: Tensor = functional_call(layers, weights, (example,))
        return found

    def residual(weights: FloatArray) -> FloatArray:
        with torch.no_grad():
            error: FloatArray = (output(named(weights), inputs) - targets).reshape(-1).numpy()
        return error

    def jacobian(weights: FloatArray) -> FloatArray:
        derivatives = vmap(jacrev(output), in_dims=(None, 0))(named(weights), inputs)
        with torch.no_grad():
            flat = torch.cat([derivatives[name].flatten(start_dim=2) for name in shapes], dim=2)
            matrix: FloatArray = flat.reshape(targets.numel(), -1).numpy()
        return matrix

    start = torch.cat([value.detach().reshape(-1) for value in layers.parameters()]).numpy()
    solution = least_squares(
        residual,
        start,
        jacobian,
        method="lm",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-15,
        max_nfev=max_evaluations,
    )
    with torch.no_grad():
        for name, parameter in layers.named_parameters():
            parameter.copy_(named(solution.x)[name])
    return float(np.mean(solution.fun**2))


def position_errors_mm(
    robot: Robot, network: InverseKinematicsNetwork, poses: FloatArray
) -> FloatArray:
    """Distance of the end effector from each pose, by forward kinematics."""
    achieved = robot.forward_kinematics.poses(network.joint_positions(poses))
    distances, _ = pose_distance(poses, achieved)
    return 1e3 * distances


def run(dataset: Dataset, unseen: FloatArray, method: str, seed: int, evaluations: int) -> Outcome:
    """Fit one start with one method and measure it."""
    options = FitOptions(max_evaluations=evaluations)
    system = InverseKinematicsSystem(dataset.robot)
    examples = dataset_examples(system, dataset, options)
    everything = np.arange(len(examples))
    rng = np.random.default_rng(seed)
    begin = time.perf_counter()
    if method == "separable":
        restart = fit_restart(examples, everything, everything[:0], options, seed, rng)
        fitted, error = restart.network, restart.training_error
    else:
        fitted = untrained_network(examples, everything, options)
        fitted.hidden.initialise(rng)
        error = fit_plain(fitted, scaled_examples(fitted, examples), evaluations)
    seconds = time.perf_counter() - begin
    network = InverseKinematicsNetwork(system.encoding, fitted)
    workspace = position_errors_mm(dataset.robot, network, unseen)
    path = position_errors_mm(dataset.robot, network, diagonal_path())
    return Outcome(
        error, float(np.sqrt(np.mean(workspace**2))), workspace.max(), path.max(), seconds
    )


def table(outcomes: dict[tuple[str, str], list[Outcome]], examples: dict[str, int]) -> str:
    """Median, and in brackets the range over the starts."""
    rows = []
    for (name, method), results in outcomes.items():
        cells = []
        for field, form in (
            ("training_error", ".1e"),
            ("workspace_rms", ".2g"),
            ("workspace_max", ".2g"),
            ("path_max", ".2g"),
            ("seconds", ".1f"),
        ):
            values = [getattr(result, field) for result in results]
            low, middle, high = min(values), float(np.median(values)), max(values)
            cells.append(f"{middle:{form}} ({low:{form}} to {high:{form}})")
        rows.append((f"{name}: {examples[name]}", method, *cells))
    header = ("examples", "method", "training error", "workspace rms [mm]", "workspace max [mm]")
    return markdown_table((*header, "path max [mm]", "time [s]"), rows)


@click.command()
@click.option("--starts", type=click.IntRange(1), help="For each set and method (default 10).")
@click.option("--evaluations", type=click.IntRange(1), help="Of each fit (default 50).")
@quick_option("Two starts, fewer evaluations")
@out_option("bench", "the table")
@docs_option("the table, in results/ there,")
def fit_methods(quick: bool, out: Path, docs: Path | None, **choices: int | None) -> None:
    """Two ways to fit the paper's network: separable and plain Levenberg-Marquardt."""
    settings = chosen(_QUICK if quick else _STANDARD, choices)
    docs = docs_folder(docs, standard=settings == _STANDARD, quick=quick)
    folders = output_folders(out, docs)
    torch.set_num_threads(1)
    robot = load_robot("gantry")
    unseen = random_dataset(robot, robot.joint_box, 2000, seed=20_000).poses
    datasets = {
        name: generate_dataset(robot, "thirty_phase", steps, 0) for name, steps in SETS.items()
    }
    outcomes: dict[tuple[str, str], list[Outcome]] = {
        (name, method): [] for name in SETS for method in METHODS
    }
    jobs = [
        (seed, name, method)
        for seed in range(settings.starts)
        for name in SETS
        for method in METHODS
    ]
    for seed, name, method in track(jobs, "fitting"):
        outcomes[name, method].append(
            run(datasets[name], unseen, method, seed, settings.evaluations)
        )
    lines = [
        "<!-- Written by ./run bench fit_methods -->",
        "",
        f"Median (range) over {settings.starts} starts, {settings.evaluations} evaluations "
        f"each. {machine()}",
        "",
        "Separable: annik's fit, on its own Levenberg-Marquardt. Plain: SciPy's (MINPACK) on all "
        "weights at once.",
        "",
        table(outcomes, {name: len(dataset) for name, dataset in datasets.items()}),
    ]
    write_table("fit_methods", lines, folders)
