"""Shared by ``./run learn`` with and without ``--sockets``: the robot, its path, its drives."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
from rich.console import Console

from annik_core.robots.robot import Robot
from annik_core.target_paths import CSV_COLUMNS
from examples.demonstration import drive, processes
from msg_tools.report.tracking import TrackingReport
from msg_tools.report.write import write_report

ROBOT = "ur5e"
#: Seed of the simulated robot's errors.
ROBOT_SEED = 7
POINTS = 201
RATE = 50.0
#: Rate of joint states and of measured poses [Hz].
MEASUREMENT_RATE = 200.0
FIT_TIMEOUT = 900.0
#: Colours and line styles of a plot, by Okabe and Ito.
STYLES = (("#E69F00", "-"), ("#0072B2", "--"))
#: Amplitude of the path in half widths of the joint box. A larger one comes to a singularity,
#: beyond which the real arm may not reach what the nominal arm does.
_AMPLITUDE = 0.6


def write_targets(robot: Robot, path: Path) -> None:
    """A closed path through the joint box, from its centre, each joint at its own frequency."""
    box = robot.joint_box
    turns = 2.0 * np.pi * np.linspace(0.0, 1.0, POINTS)[:, np.newaxis]
    frequencies = 1 + np.arange(robot.dof) % 3
    half = 0.5 * (box.upper - box.lower)
    joint_positions = box.centre + _AMPLITUDE * half * np.sin(turns * frequencies)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(CSV_COLUMNS)
        writer.writerows(robot.forward_kinematics.poses(joint_positions).tolist())


def drive_along(
    name: str,
    model: str,
    robot: dict[str, object],
    targets: Path,
    folder: Path,
    logs: Path,
    console: Console,
) -> TrackingReport:
    """Drive the robot with a model along its targets, and report."""
    out = folder / name
    with console.status(f"driving with the {name} model"), processes(logs) as started:
        path: dict[str, object] = {"path": "csv", "csv_file": targets}
        drive(started, f"{name}_", out / "bag", POINTS, RATE, {"model": model}, robot, path)
    return write_report(out / "bag", out)
