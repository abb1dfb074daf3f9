"""Train every packaged arm as ``annik train`` does, and measure it on fresh targets.

Writes the packaged models, models/ROBOT.onnx, and docs/results/arms.md. The targets are drawn
apart from everything that training draws. What is solved is verified by forward kinematics that
share no code with the solver's. Each model answers in a process without torch, as in a node.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from annik_core.model.artifact import load_model
from annik_core.robots.library import load_robot, packaged_robots
from annik_training.designs.sampling import compute_dataset, compute_random_dataset
from annik_training.fitting.options import ARM_OPTIONS
from annik_training.train import train
from benchmarks.answer_targets import PASSES, answers_of
from benchmarks.conditions import machine
from benchmarks.ik.annik import our_solvers
from benchmarks.ik.measure_paths import measure_paths
from benchmarks.ik.robot_problem import robot_problem
from benchmarks.ik.straight_paths import straight_paths
from benchmarks.ik.verification import Verifier

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "docs" / "results" / "arms.md"
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


def main() -> None:
    """Train, measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--examples", type=int, nargs="+", default=[EXAMPLES, FEW_EXAMPLES])
    parser.add_argument("--targets", type=int, default=2000)
    parser.add_argument("--paths", type=int, default=200)
    parser.add_argument("--robots", nargs="+", default=_arms())
    arguments = parser.parse_args()
    lines = [
        "<!-- Written by ./run bench arms -->",
        "",
        f"{arguments.targets} targets, {arguments.paths} straight paths of {_POINTS} points, one "
        f"seed; times of the quietest of {PASSES} passes over the targets. {machine()}",
        "",
        "| " + " | ".join(_HEADER) + " |",
        "| " + " | ".join("---" for _ in _HEADER) + " |",
    ]
    for examples in arguments.examples:
        for name in arguments.robots:
            row = _measured(name, examples, arguments.targets, arguments.paths)
            lines.append("| " + " | ".join(row) + " |")
            print(lines[-1], flush=True)
    # A table of some robots only is for the eye.
    if arguments.robots == _arms():
        RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _arms() -> list[str]:
    return [name for name in packaged_robots() if load_robot(name).kind == "arm"]


def _measured(name: str, examples: int, targets: int, paths: int) -> tuple[str, ...]:
    """A row of the table."""
    robot = load_robot(name)
    # The packaged models are those with the usual number of examples.
    model = ROOT / ("models" if examples == EXAMPLES else "build/arms") / f"{name}.onnx"
    trained = train(compute_dataset(robot, "sobol", examples, seed=0), model, ARM_OPTIONS)
    unseen = compute_random_dataset(robot, robot.joint_box, targets, _TARGET_SEED)
    answers = answers_of(model, unseen.poses)
    steps = answers.newton_steps[np.isfinite(answers.joint_positions).all(axis=1)]
    verifier = Verifier(robot_problem(robot))
    verified = verifier.verified(answers.joint_positions, unseen.poses)
    refined = our_solvers(load_model(model))[-1]
    followed, _ = straight_paths(robot, paths, _POINTS, np.random.default_rng(_TARGET_SEED))
    on_paths = measure_paths([refined], followed, verifier)[refined.name]
    errors = trained.evaluation.position_error
    return (
        name,
        f"{examples}",
        f"{trained.fitted.seconds:.0f}",
        f"{1e3 * errors.p50:.1f}, {1e3 * errors.p99:.0f}",
        f"{100 * verified.right.mean():.2f}",
        f"{100 * verified.in_box.mean():.2f}",
        f"{np.mean(steps):.1f}, {max(steps, default=0)}",
        f"{np.median(answers.microseconds):.0f}, {np.percentile(answers.microseconds, 99):.0f}",
        f"{on_paths.changing} of {on_paths.paths}",
    )


if __name__ == "__main__":
    main()
