"""Calibrate a simulated robot in one command: measure, calibrate, drive, before and after.

The robot is a ``fake_robot`` with errors of geometry, joint zeros and transmissions that no other
part knows. Each part runs as its user would run it: ``example_collector`` measures poses over DDS,
``annik calibrate`` calibrates the robot, and ``ik_node`` drives it along one path, with the
nominal model and with the calibrated one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from annik_core.files import write_files_atomically
from annik_core.robots.library import load_robot
from annik_training.cli.plots import png
from examples.before_and_after import (
    FIT_TIMEOUT,
    MEASUREMENT_RATE,
    POINTS,
    ROBOT,
    ROBOT_SEED,
    STYLES,
    drive_along,
    write_targets,
)
from examples.demonstration import (
    END_TIMEOUT,
    START_TIMEOUT,
    emptied,
    out_option,
    processes,
    run_demonstration,
)
from examples.learn_sockets import ROWS, run_learn_sockets
from msg_tools.report.tracking import TrackingReport

EXAMPLES = 102
#: Limits of the simulated robot, which has no mass [rad/s, rad/s^2].
_VELOCITY, _ACCELERATION = 20.0, 500.0
_COLLECT_TIMEOUT = 900.0


def run_learn(folder: Path, examples: int, console: Console) -> str:
    """Run the demonstration.

    Args:
        folder: for ``plan.npz``, ``measured.npz`` and its journal, ``learned.onnx``, the bags
            and reports ``nominal/`` and ``learned/``, ``before_and_after.png``, ``results.json``
            and ``logs/``.
        examples: number of poses to measure.
        console: for progress messages.

    Returns:
        Where the results are.

    Raises:
        AnnikError: if a part fails; names it and shows the end of its log.
    """
    with emptied(folder) as logs:
        return _learn(folder, logs, examples, console)


def _learn(folder: Path, logs: Path, examples: int, console: Console) -> str:
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
            measurement_rate=MEASUREMENT_RATE,
            **robot,
        )
        fake_robot.wait_for_text("fake robot ", START_TIMEOUT)
        started.node(
            "example_collector",
            "annik_ros.example_collector.node",
            plan=plan,
            dataset=measured,
            max_joint_velocity=_VELOCITY,
            max_joint_acceleration=_ACCELERATION,
            command_rate=MEASUREMENT_RATE,
            settle_time=0.05,
            max_measured_step=2.0,
            measurement_timeout=10.0,
        ).wait(_COLLECT_TIMEOUT)
        fake_robot.interrupt(END_TIMEOUT)
    console.print(f"measured {examples} poses of a {ROBOT} with errors")
    summary = folder / "fit.json"
    with console.status("calibrating the robot"), processes(logs) as started:
        started.annik(
            "calibrate",
            *("calibrate", "--measured", str(measured), "--nominal", ROBOT),
            *("--out", str(model), "--summary", str(summary)),
        ).wait(FIT_TIMEOUT)
    fit: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    console.print(f"calibrated {', '.join(fit['parts'])} in {fit['seconds']:.1f} s")
    targets = folder / "targets.csv"
    write_targets(load_robot(ROBOT), targets)
    reports = {
        name: drive_along(name, parameters, robot, targets, folder, logs, console)
        for name, parameters in (("nominal", ROBOT), ("learned", str(model)))
    }
    for name, report in reports.items():
        errors = [target.position_error_mm for target in report.targets]
        console.print(
            f"{name} model: {len(errors)} of {POINTS} targets, missed by {np.mean(errors):.4f} mm "
            f"on average, {np.max(errors):.4f} mm at most"
        )
    results = {name: report.to_dict() for name, report in reports.items()}
    text = json.dumps({"fit": fit, **results}, indent=2) + "\n"
    figure = folder / "before_and_after.png"
    write_files_atomically(
        folder, {figure.name: comparison_plot(reports), "results.json": text.encode()}
    )
    return f"before and after: {figure}"


def comparison_plot(reports: Mapping[str, TrackingReport]) -> bytes:
    """Errors of every target of two recordings, by name, as PNG with logarithmic axes.

    A recording without targets has no line.
    """
    figure = Figure(figsize=(9.0, 5.4), dpi=120, layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for (name, report), (colour, line) in zip(reports.items(), STYLES, strict=True):
        numbers = [target.number for target in report.targets]
        for axes, unit, errors in (
            (upper, "mm", [target.position_error_mm for target in report.targets]),
            (lower, "deg", [target.orientation_error_deg for target in report.targets]),
        ):
            if errors:
                label = f"{name}: mean {np.mean(errors):.3g} {unit}"
                axes.plot(numbers, errors, line, color=colour, label=label)
    for axes, label in ((upper, "position error [mm]"), (lower, "orientation error [deg]")):
        axes.set_yscale("log")
        axes.set_ylabel(label)
        axes.grid(visible=True, which="both", alpha=0.3)
        axes.legend()
    lower.set_xlabel("target")
    return png(figure)


@click.command()
@out_option("build/learn")
@click.option(
    "--examples",
    type=click.IntRange(1),
    help=f"Number of poses to measure (default {EXAMPLES}), or of rows in each socket ({ROWS}).",
)
@click.option(
    "--sockets",
    is_flag=True,
    help="Without an instrument: a ball at the hand, guided into printed sockets.",
)
def main(out: Path, examples: int | None, sockets: bool) -> None:
    """Measure, calibrate and drive a simulated robot; before and after."""
    run, usual = (run_learn_sockets, ROWS) if sockets else (run_learn, EXAMPLES)
    run_demonstration("learn", lambda console: run(out, examples or usual, console))


if __name__ == "__main__":
    main()
