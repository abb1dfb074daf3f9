"""Calibrate a simulated robot in one command: measure, calibrate, drive, before and after.

The robot is a ``fake_robot`` with errors of geometry, joint zeros and transmissions that no other
part knows. Each part runs as its user would run it: ``example_collector`` measures poses over DDS,
``annik calibrate`` calibrates the robot, and ``ik_node`` drives it along one path, with the
nominal model and with the calibrated one.
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from annik_core.files import write_files_atomically
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.target_paths import CSV_COLUMNS
from examples.demonstration import (
    END_TIMEOUT,
    START_TIMEOUT,
    demonstration_parser,
    drive,
    make_empty,
    processes,
    run_demonstration,
)
from msg_tools.report.plots import comparison_plot
from msg_tools.report.tracking import TrackingReport
from msg_tools.report.write import write_report

ROBOT = "ur5e"
#: Which robot the fake one is: it draws its errors by it.
ROBOT_SEED = 7
EXAMPLES = 102
POINTS = 201
RATE = 50.0
#: Of the half width of the working box, how far the path goes from its middle. Farther, it comes
#: to a singularity of the arm, beyond which a real one may not reach what the nominal one does.
_AMPLITUDE = 0.6
#: A robot with nothing to move needs no time [rad/s, rad/s^2].
_VELOCITY, _ACCELERATION = 20.0, 500.0
_MEASUREMENT_RATE = 200.0
_COLLECT_TIMEOUT = 900.0
_FIT_TIMEOUT = 900.0


def run_learn(folder: Path, examples: int, console: Console) -> str:
    """Run it and leave everything it makes in a folder.

    Args:
        folder: gets ``plan.npz``, ``measured.npz`` and its journal, ``learned.onnx``, the bags
            and reports ``before/`` and ``after/``, ``before_and_after.png``, ``results.json`` and
            ``logs/``.
        examples: how many poses to measure.
        console: told of the progress.

    Returns:
        Where to look.

    Raises:
        AnnikError: if a part fails; names it and shows the end of its log.
    """
    logs = make_empty(folder)
    plan, measured, model = (
        folder / name for name in ("plan.npz", "measured.npz", "learned.onnx")
    )
    robot: dict[str, object] = {"robot": ROBOT, "imperfection_seed": ROBOT_SEED}
    with console.status(f"measuring {examples} poses"), processes(logs) as started:
        started.annik(
            "design",
            *("design", "sobol", "--robot", ROBOT, "--examples", str(examples)),
            *("--out", str(plan)),
        ).wait(START_TIMEOUT)
        fake_robot = started.node(
            "fake_robot",
            "annik_ros.fake_robot.node",
            measurement_rate=_MEASUREMENT_RATE,
            **robot,
        )
        fake_robot.wait_for_text("joint_command -> joint_states", START_TIMEOUT)
        started.node(
            "example_collector",
            "annik_ros.example_collector.node",
            plan=plan,
            dataset=measured,
            max_joint_velocity=_VELOCITY,
            max_joint_acceleration=_ACCELERATION,
            command_rate=_MEASUREMENT_RATE,
            settle_time=0.05,
            max_measured_step=2.0,
            measurement_timeout=10.0,
        ).wait(_COLLECT_TIMEOUT)
        fake_robot.interrupt(END_TIMEOUT)
    console.print(f"measured {examples} poses of a {ROBOT} that is not as described")
    summary = folder / "fit.json"
    with console.status("learning the robot"), processes(logs) as started:
        started.annik(
            "calibrate",
            *("calibrate", "--measured", str(measured), "--nominal", ROBOT),
            *("--out", str(model), "--summary", str(summary)),
        ).wait(_FIT_TIMEOUT)
    fit: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    console.print(f"learned {', '.join(fit['parts'])} in {fit['seconds']:.1f} s")
    targets = folder / "targets.csv"
    _write_targets(load_robot(ROBOT), targets)
    reports = {
        name: _drive(name, parameters, robot, targets, folder, logs, console)
        for name, parameters in (("nominal", ROBOT), ("learned", str(model)))
    }
    results = {name: report.to_dict() for name, report in reports.items()}
    text = json.dumps({"fit": fit, **results}, indent=2) + "\n"
    figure = folder / "before_and_after.png"
    write_files_atomically(
        folder, {figure.name: comparison_plot(reports), "results.json": text.encode()}
    )
    return f"before and after: {figure}"


def _write_targets(robot: Robot, path: Path) -> None:
    """A closed path through the working box, from its middle, each joint at its own pace."""
    box = robot.joint_box
    turns = 2.0 * np.pi * np.linspace(0.0, 1.0, POINTS)[:, np.newaxis]
    paces = 1 + np.arange(robot.dof) % 3
    half = 0.5 * (box.upper - box.lower)
    joint_positions = box.centre + _AMPLITUDE * half * np.sin(turns * paces)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(CSV_COLUMNS)
        writer.writerows(robot.forward_kinematics.poses(joint_positions).tolist())


def _drive(
    name: str,
    model: str,
    robot: dict[str, object],
    targets: Path,
    folder: Path,
    logs: Path,
    console: Console,
) -> TrackingReport:
    """Drive the same robot with a model, and report."""
    out = folder / name
    with console.status(f"driving with the {name} model"), processes(logs) as started:
        path: dict[str, object] = {"path": "csv", "csv_file": targets}
        drive(started, f"{name}_", out / "bag", POINTS, RATE, {"model": model}, robot, path)
    report = write_report(out / "bag", out)
    errors = [target.position_error_mm for target in report.targets]
    console.print(
        f"{name} model: {len(errors)} of {POINTS} targets, missed by {np.mean(errors):.4f} mm on "
        f"average, {np.max(errors):.4f} mm at most"
    )
    return report


def main() -> int:
    """Run it; returns the exit code."""
    parser = demonstration_parser("Measure, learn and drive a robot.", Path("build/learn"))
    parser.add_argument("--examples", type=int, default=EXAMPLES, help="how many poses to measure")
    arguments = parser.parse_args()
    return run_demonstration(
        "learn", lambda console: run_learn(arguments.out, arguments.examples, console)
    )


if __name__ == "__main__":
    sys.exit(main())
