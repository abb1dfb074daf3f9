"""Train every packaged arm as ``annik train`` does, and measure it on fresh targets.

The targets are drawn from another seed than the examples. What is solved is verified by forward
kinematics that share no code with the solver's. Each model solves in a process without torch, as
in a node.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from annik_core.model.artifact import load_model
from annik_core.robots.library import load_robot, packaged_robots
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.training import train
from benchmarks.command_line import (
    ROOT,
    chosen,
    docs_folder,
    docs_option,
    names,
    numbers,
    out_option,
    output_folders,
    quick_option,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.ik.annik import our_solvers
from benchmarks.ik.measure_paths import measure_paths
from benchmarks.ik.robot_problem import robot_problem
from benchmarks.ik.straight_paths import straight_paths
from benchmarks.ik.verification import Verifier
from benchmarks.markdown import markdown_table
from benchmarks.solve_targets import PASSES, solutions_of

#: As ``annik train`` takes them for an arm.
EXAMPLES = 512
#: A quarter of them, to show what that costs.
FEW_EXAMPLES = 128
_TARGET_SEED = 20261122
_POINTS = 100
_HEADER = (
    "robot",
    "examples",
    "training [s]",
    "network alone: median, p99 [mm]",
    "solved [%]",
    "in the box [%]",
    "steps: mean, most",
    "solve: median, p99 [us]",
    "branch changes",
)


@dataclass(frozen=True)
class _Settings:
    examples: tuple[int, ...] = (EXAMPLES, FEW_EXAMPLES)
    targets: int = 2000
    paths: int = 200
    robots: tuple[str, ...] = ()  #: none: all packaged arms


_STANDARD = _Settings()
_QUICK = _Settings(examples=(FEW_EXAMPLES,), targets=100, paths=5, robots=("scara",))


@click.command()
@click.option("--examples", callback=numbers, help="For each model (default 512,128).")
@click.option("--targets", type=click.IntRange(1), help="Random poses (default 2000).")
@click.option("--paths", type=click.IntRange(1), help="Straight paths (default 200).")
@click.option("--robots", callback=names, help="Packaged arms (default: all).")
@quick_option("One arm, roughly")
@out_option("bench", "the table, and the models in models/")
@docs_option("the table, in results/ there,")
def arms(quick: bool, out: Path, docs: Path | None, **choices: Any) -> None:
    """Train the packaged arms anew and measure the models.

    With the standard settings the models of the checkout are replaced.
    """
    settings = chosen(_QUICK if quick else _STANDARD, choices)
    standard = settings == _STANDARD
    docs = docs_folder(docs, standard=standard, quick=quick)
    folders = output_folders(out, docs)
    packaged_arms = [name for name in packaged_robots() if load_robot(name).kind == "arm"]
    rows = []
    for examples in settings.examples:
        # The packaged models are those with the usual number of examples.
        models = ROOT / "models" if standard and examples == EXAMPLES else out / "models"
        for name in settings.robots or packaged_arms:
            rows.append(_measured(name, examples, settings, models))
            click.echo(", ".join(rows[-1]))
    lines = [
        "<!-- Written by ./run bench arms -->",
        "",
        f"{settings.targets} targets, {settings.paths} straight paths of {_POINTS} points, one "
        f"seed; times of the quietest of {PASSES} passes over the targets. {machine()}",
        "",
        markdown_table(_HEADER, rows),
    ]
    write_table("arms", lines, folders)


def _measured(name: str, examples: int, settings: _Settings, models: Path) -> tuple[str, ...]:
    """A row of the table."""
    robot = load_robot(name)
    models.mkdir(parents=True, exist_ok=True)
    model = models / f"{name}.onnx"
    trained = train(generate_dataset(robot, "sobol", examples, seed=0), model)
    unseen = random_dataset(robot, robot.joint_box, settings.targets, _TARGET_SEED)
    solutions = solutions_of(model, unseen.poses)
    steps = solutions.newton_steps[np.isfinite(solutions.joint_positions).all(axis=1)]
    verifier = Verifier(robot_problem(robot))
    verified = verifier.verified(solutions.joint_positions, unseen.poses)
    refined = our_solvers(load_model(model))[-1]
    followed, _ = straight_paths(
        robot, settings.paths, _POINTS, np.random.default_rng(_TARGET_SEED)
    )
    on_paths = measure_paths([refined], followed, verifier)[refined.name]
    errors = trained.evaluation.position_error
    median, p99 = np.percentile(solutions.microseconds, [50, 99])
    return (
        name,
        f"{examples}",
        f"{trained.fitted.seconds:.0f}",
        f"{1e3 * errors.p50:.1f}, {1e3 * errors.p99:.0f}",
        f"{100 * verified.right.mean():.2f}",
        f"{100 * verified.in_box.mean():.2f}",
        f"{np.mean(steps):.1f}, {max(steps, default=0)}",
        f"{median:.0f}, {p99:.0f}",
        f"{on_paths.changing} of {on_paths.paths}",
    )
