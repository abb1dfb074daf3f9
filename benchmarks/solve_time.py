"""How long one target takes, part by part, measured in turn in one run.

Each round answers one random pose of the workspace with every part, so that whatever slows the
machine slows all of them. Ratios to the bare network are what to compare between machines. Writes
docs/results/solve_time.md.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from annik_core.model.artifact import default_model_path
from annik_core.pose import FloatArray, checked_pose, pose_difference
from annik_core.solver.ik_solver import IkSolver
from benchmarks.conditions import machine

RESULT = Path(__file__).parents[1] / "docs" / "results" / "solve_time.md"


def main() -> None:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5000)
    rounds = parser.parse_args().rounds
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
    lines = [
        "<!-- Written by ./run bench solve_time -->",
        "",
        f"{rounds} rounds. {machine()}",
        "",
        "| part | median [us] | p99 [us] | median / network |",
        "| --- | --- | --- | --- |",
    ]
    for name, values in times.items():
        median, high = np.percentile(values, [50, 99])
        lines.append(f"| {name} | {median:.0f} | {high:.0f} | {median / reference:.1f} |")
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
