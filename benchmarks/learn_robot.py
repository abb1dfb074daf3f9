"""Calibrate simulated UR5es that differ from their description, from few measured poses.

Each robot is a seed of :class:`benchmarks.perturbed_ur5e.PerturbedUr5e`, whose kinematics share no
code with annik's. The held-out poses are the true ones of that robot, without noise, at random
joint positions of the joint box, as far from its faces as the errors of the joints. Error: the
distance from the target to where the robot is at the joint positions of the solution. The seeds
were not used in development.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from annik_core.dataset import MEASURED, Dataset
from annik_core.model.artifact import Model, load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.solver.ik_solver import IkSolver
from annik_training.calibration.calibrate import (
    CalibratedRobot,
    CalibrationOptions,
    calibrate,
)
from annik_training.calibration.estimation import tuned
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise, Observations
from annik_training.cli.plots import png
from annik_training.defaults import DEFAULTS
from annik_training.designs.registry import DESIGNS, generate_dataset, make_design
from annik_training.fitting.fit import fit
from annik_training.fitting.options import FitOptions
from annik_training.training import train
from benchmarks.command_line import (
    chosen,
    docs_folder,
    docs_option,
    numbers,
    out_option,
    output_folders,
    quick_option,
    write_results,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table
from benchmarks.perturbed_ur5e import ORIENTATION_NOISE, POSITION_NOISE, PerturbedUr5e, measured

FIGURE = "learn_robot.png"
SEEDS = (31415, 31416, 31417, 31418, 31419)
HELD_OUT = 1000
#: Nearer to a face of the joint box [rad], the real robot's pose may have no solution in it.
_MARGIN = np.radians(1.0)
#: Part of the examples that are made outliers, and by how much, in the one row with outliers.
_OUTLIERS, _OUTLIER_POSITION, _OUTLIER_ANGLE = 0.05, 5e-3, 0.02
SIZES = (20, 30, 50, 102, 200, 500)
_ERROR_TICKS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # [mm]
SWEPT = ("thirty_phase", "thirty_phase_plus", "latin_hypercube", "sobol", "identifiability")

_NOMINAL = load_robot("ur5e")
_WITHIN = "positions and orientations within the stated 95 % bound [%]"


@dataclass(frozen=True)
class _Settings:
    seeds: tuple[int, ...] = SEEDS
    sizes: tuple[int, ...] = SIZES
    designs: tuple[str, ...] = SWEPT


_STANDARD = _Settings()
_QUICK = _Settings(seeds=SEEDS[:1], sizes=SIZES[:1], designs=("sobol",))


@click.command()
@click.option(
    "--seeds", callback=numbers, help=f"Of the robots (default {', '.join(map(str, SEEDS))})."
)
@click.option("--sizes", callback=numbers, help=f"Examples (default {','.join(map(str, SIZES))}).")
@quick_option("One robot")
@out_option("bench", "the table, the figure and the models")
@docs_option("the table, in results/ there, and the figure, in images/,")
def learn_robot(quick: bool, out: Path, docs: Path | None, **choices: Any) -> None:
    """Calibrate simulated UR5es that differ from their description. Takes about an hour."""
    settings = chosen(_QUICK if quick else _STANDARD, choices)
    docs = docs_folder(docs, standard=settings == _STANDARD, quick=quick)
    folders, image_folders = output_folders(out, docs), output_folders(out, docs, "images")
    header, rows = _robots(settings.seeds, out / "learn_robot")
    sweep = _sweep(settings)
    sweep_rows = [
        (
            design,
            *(
                f"{1e3 * error:.4f} ({count})" if count != size else f"{1e3 * error:.4f}"
                for size, (count, error) in zip(settings.sizes, points, strict=True)
            ),
        )
        for design, points in sweep.items()
    ]
    lines = [
        "<!-- Written by ./run bench learn_robot -->",
        "",
        f"{len(settings.seeds)} robots, {HELD_OUT} held-out poses of each, without noise; "
        f"errors of position [mm]: mean, worst. {machine()}",
        "",
        markdown_table(header, rows),
        "",
        "By design of experiments and number of examples: mean error [mm], median of these "
        "robots; the same parts of the model for all, geometry and joint series. Examples in "
        "parentheses where a design can't have that number.",
        "",
        markdown_table(("design", *map(str, settings.sizes)), sweep_rows),
    ]
    write_table("learn_robot", lines, folders)
    write_results(image_folders, {FIGURE: _figure(sweep)})


def _robots(seeds: Sequence[int], models: Path) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """The table of what is learned of each robot."""
    columns: dict[str, dict[int, str]] = {}
    for seed in seeds:
        for name, value in _one_robot(seed, models).items():
            columns.setdefault(name, {})[seed] = value
            click.echo(f"{seed} {name} {value}")
    header = ("learned from", *(f"robot {seed}" for seed in seeds))
    rows = [(name, *(values[seed] for seed in seeds)) for name, values in columns.items()]
    return header, rows


def _one_robot(seed: int, models: Path) -> dict[str, str]:
    robot, yielding = PerturbedUr5e(seed), PerturbedUr5e(seed, yields=True)
    box = _NOMINAL.joint_box
    rng = np.random.default_rng([seed, HELD_OUT])
    aims = rng.uniform(box.lower + _MARGIN, box.upper - _MARGIN, (HELD_OUT, 6))
    targets = _poses(*robot.pose(aims))
    nominal = load_model("ur5e")
    row = {"nothing: the nominal model": _errors(nominal, robot, targets)[0]}
    main_dataset = _measured_dataset(robot, "sobol", 102, seed)
    learned = calibrate(_NOMINAL, main_dataset)
    models.mkdir(parents=True, exist_ok=True)
    path = models / f"{seed}.onnx"
    train(generate_dataset(learned.robot, "sobol", 512, 0), path)
    served = load_model(path)
    row["**102 Sobol examples**"], within = _errors(served, robot, targets)
    row[_WITHIN] = within
    bent = calibrate(_NOMINAL, _measured_dataset(yielding, "sobol", 102, seed))
    row["**102, joints yield to gravity**"], within = _errors(
        _served(served, bent), yielding, _poses(*yielding.pose(aims))
    )
    row[f"of these, {_WITHIN}"] = within
    usual, position_only = CalibrationOptions(), CalibrationOptions(position_only=True)
    few = _measured_dataset(robot, "sobol", 30, seed)
    identifiability = _measured_dataset(robot, "identifiability", 102, seed)
    for name, dataset, options in (
        ("50", _measured_dataset(robot, "sobol", 50, seed), usual),
        ("30", few, usual),
        ("102, identifiability design", identifiability, usual),
        ("102, positions only", main_dataset, position_only),
        ("30, positions only", few, position_only),
        ("102, 5 % of them gross outliers", _with_outliers(main_dataset, seed), usual),
    ):
        changed = calibrate(_NOMINAL, dataset, options)
        row[name] = _errors(_served(served, changed), robot, targets)[0]
    networks = (
        ("102, the paper's network alone (6-20-6)", FitOptions(seed=0)),
        ("102, a network alone, with the nominal slopes", replace(DEFAULTS["arm"].fit, seed=0)),
    )
    for name, fit_options in networks:
        network = fit(main_dataset, fit_options).network
        row[name] = _distances(robot, network.joint_positions(targets), targets)
    return row


def _served(artifact: Model, learned: CalibratedRobot) -> Model:
    """The same network as a start, for another learned robot."""
    return replace(artifact, robot=learned.robot)


def _poses(positions: FloatArray, rotations: FloatArray) -> FloatArray:
    quaternions = Rotation.from_matrix(rotations).as_quat(canonical=True)
    return np.concatenate([positions, quaternions], axis=1)


def _measured_dataset(robot: PerturbedUr5e, design: str, size: int, seed: int) -> Dataset:
    joint_positions = make_design(_NOMINAL, design, size, seed)
    rng = np.random.default_rng([seed, len(joint_positions)])
    return Dataset(
        _NOMINAL,
        joint_positions,
        _poses(*measured(robot, joint_positions, rng)),
        design,
        {"size": size},
        seed,
        MEASURED,
        (POSITION_NOISE, ORIENTATION_NOISE),
    )


def _with_outliers(dataset: Dataset, seed: int) -> Dataset:
    rng = np.random.default_rng([seed, 5])
    rows = rng.choice(len(dataset), int(_OUTLIERS * len(dataset)), replace=False)
    poses = dataset.poses.copy()
    poses[rows, :3] += rng.normal(0.0, _OUTLIER_POSITION, (len(rows), 3))
    turns = Rotation.from_rotvec(rng.normal(0.0, _OUTLIER_ANGLE, (len(rows), 3)))
    poses[rows, 3:] = (Rotation.from_quat(poses[rows, 3:]) * turns).as_quat(canonical=True)
    return replace(dataset, poses=poses)


def _errors(artifact: Model, robot: PerturbedUr5e, targets: FloatArray) -> tuple[str, str]:
    """Errors of the commanded robot, and the part of the poses within the stated bounds."""
    solver = IkSolver(artifact)
    results = [solver.solve(target) for target in targets]
    solved = [result.joint_positions is not None for result in results]
    commands = np.array(
        [result.joint_positions for result in results if result.joint_positions is not None]
    )
    reached, turned = robot.pose(commands)
    wanted = targets[solved]
    distances = np.linalg.norm(reached - wanted[:, :3], axis=1)
    angles = (Rotation.from_quat(wanted[:, 3:]).inv() * Rotation.from_matrix(turned)).magnitude()
    missing = len(targets) - len(commands)
    text = _mean_and_worst(distances) + (f" ({missing} refused)" if missing else "")
    bound = artifact.robot.error_bound
    if bound is None:
        return text, ""
    bounds = np.array([bound.at(command) for command in commands])
    within = 100 * (np.stack([distances, angles], axis=1) <= bounds).mean(axis=0)
    return text, f"{within[0]:.1f}, {within[1]:.1f}"


def _distances(robot: PerturbedUr5e, commands: FloatArray, targets: FloatArray) -> str:
    reached, _ = robot.pose(commands)
    return _mean_and_worst(np.linalg.norm(reached - targets[:, :3], axis=1))


def _mean_and_worst(distances: FloatArray) -> str:
    return f"{1e3 * distances.mean():.4f}, {1e3 * distances.max():.4f}"


def _sweep(settings: _Settings) -> dict[str, list[tuple[int, float]]]:
    """Number of examples and mean error by design and wanted number."""
    model = ParametricModel(_NOMINAL, frozenset({Part.GEOMETRY, Part.JOINT_SERIES}))
    noise = Noise(POSITION_NOISE, ORIENTATION_NOISE)
    swept: dict[str, list[tuple[int, float]]] = {}
    for design in settings.designs:
        for size in settings.sizes:
            chosen = _size_of(design, size)
            errors = []
            for seed in settings.seeds:
                robot = PerturbedUr5e(seed)
                dataset = _measured_dataset(robot, design, chosen, seed)
                fitted = tuned(model, Observations.of(dataset), noise, np.zeros(model.size))
                held_out = _NOMINAL.joint_box.sample(HELD_OUT, np.random.default_rng([seed, 7]))
                where, _ = model.positions_and_rotations(fitted.parameters, held_out)
                errors.append(np.linalg.norm(where - robot.pose(held_out)[0], axis=1).mean())
            swept.setdefault(design, []).append((len(dataset), float(np.median(errors))))
            click.echo(f"{design} {size} {swept[design][-1]}")
    return swept


def _size_of(design: str, examples: int) -> int:
    """The size with which a design has the number of examples nearest to ``examples``."""
    if DESIGNS[design].size.name == "examples":
        return examples
    counts = {
        size: len(make_design(_NOMINAL, design, size, 0))
        for size in range(DESIGNS[design].size.minimum, 40)
    }
    return min(counts, key=lambda size: abs(counts[size] - examples))


def _figure(sweep: dict[str, list[tuple[int, float]]]) -> bytes:
    figure = Figure(figsize=(7, 4.5), dpi=110, layout="constrained")
    axes: Any = figure.subplots()
    for design, points in sweep.items():
        counts, errors = zip(*points, strict=True)
        axes.plot(counts, 1e3 * np.array(errors), "o-", label=design)
    axes.axhline(1e3 * POSITION_NOISE, color="grey", linestyle=":", label="noise of a coordinate")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(SIZES, [str(size) for size in SIZES])
    low, high = axes.get_ylim()
    ticks = [tick for tick in _ERROR_TICKS if low < tick < high]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.set_xlabel("measured poses")
    axes.set_ylabel("mean position error of the learned UR5e [mm]")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    return png(figure)
