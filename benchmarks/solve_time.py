"""How long one target takes, part by part, measured in turn in one run.

Each round times every part on one random pose of the workspace, so that other load on the machine
slows all of them. Compare the ratios to the network between machines, not the times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray, checked_pose, pose_difference
from annik_core.solver.ik_solver import IkSolver
from benchmarks.command_line import (
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    quick_option,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table

_ROUNDS, _QUICK_ROUNDS = 5000, 200


@click.command()
@click.option("--rounds", type=click.IntRange(1), help=f"Targets (default {_ROUNDS}).")
@quick_option("Fewer rounds")
@out_option("bench", "the table")
@docs_option("the table, in results/ there,")
def solve_time(rounds: int | None, quick: bool, out: Path, docs: Path | None) -> None:
    """The time of a solve of the gantry, part by part."""
    rounds = rounds or (_QUICK_ROUNDS if quick else _ROUNDS)
    docs = docs_folder(docs, standard=rounds == _ROUNDS, quick=quick)
    folders = output_folders(out, docs)
    solver = IkSolver.from_file(default_model_path())
    robot = solver.robot
    rng = np.random.default_rng(0)
    joints = robot.joint_box.sample(rounds, rng)
    poses = robot.forward_kinematics.poses(joints)
    previous = robot.joint_box.centre
    parts: dict[str, Callable[[FloatArray], object]] = {
        "network": lambda pose: solver.artifact.joint_positions(pose[np.newaxis]),
        "pose check": checked_pose,
        "workspace": lambda pose: robot.workspace.resolve(pose, previous),
        "forward kinematics": lambda pose: robot.forward_kinematics.poses(previous[np.newaxis]),
        "residual": lambda pose: pose_difference(pose, poses[0]),
        "whole solve": lambda pose: solver.solve(pose, previous),
    }
    times: dict[str, list[float]] = {name: [] for name in parts}
    for pose in poses:
        for name, part in parts.items():
            begin = time.perf_counter()
            part(pose)
            times[name].append(1e6 * (time.perf_counter() - begin))
    reference = float(np.median(times["network"]))
    rows = [
        (name, f"{median:.0f}", f"{p99:.0f}", f"{median / reference:.1f}")
        for name, values in times.items()
        for median, p99 in [np.percentile(values, [50, 99])]
    ]
    lines = [
        "<!-- Written by ./run bench solve_time -->",
        "",
        f"{rounds} rounds. {machine()}",
        "",
        markdown_table(("part", "median [us]", "p99 [us]", "median / network"), rows),
    ]
    write_table("solve_time", lines, folders)
