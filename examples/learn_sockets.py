"""Calibrate a simulated robot without an instrument: by a ball at its hand and printed sockets.

The robot is a ``fake_robot`` with errors of geometry, joint zeros and transmissions, whose joints
yield to gravity. A simulated person guides its ball into the two sockets of a printed base, at
several places; ``example_collector`` records the joint positions over DDS, and ``annik calibrate``
calibrates the robot from these files.

Sockets don't tell where the base of the robot is, so before and after are compared without it:

- at a place that was not used: the balls that the model computes for the rows of one socket should
  be one point;
- along a path that ``ik_node`` drives the robot: how far the ball is from its targets after a
  motion of the whole path, the best one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from scipy.spatial.transform import Rotation

from annik_core.errors import AnnikError
from annik_core.files import write_file, write_files_atomically
from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import ForwardKinematics, Robot
from annik_core.simulation.imperfections import (
    ImperfectionMagnitudes,
    imperfect_kinematics,
    random_imperfections,
)
from annik_training.cli.plots import png
from examples.before_and_after import (
    FIT_TIMEOUT,
    MEASUREMENT_RATE,
    ROBOT,
    ROBOT_SEED,
    STYLES,
    drive_along,
    write_targets,
)
from examples.demonstration import END_TIMEOUT, START_TIMEOUT, emptied, processes
from msg_tools.report.tracking import TrackingReport

#: Rows in each socket.
ROWS = 30
#: Most that a joint yields [rad/(N m)]: the arm bends by millimetres.
_COMPLIANCE = 5e-5
#: The ball in the frame of the flange [m].
_BALL = "0.03 0.0 0.08"
#: Places of the first socket [m], and directions to the second [rad].
_PLACES = ((0.45, 0.15, 0.05, 0.3), (0.30, -0.40, 0.25, 1.4), (0.15, 0.55, 0.45, 2.5))
#: The place that is left out of the calibration.
_HELD_OUT = (0.55, -0.20, 0.35, 0.9)
_SOCKET_DISTANCE = 0.05
#: Standard deviation of the ball's place in a printed socket, along each axis [m].
_PLAY = 3e-5
#: Largest angle of the ball's holder from the upright [rad].
_MOST_TILT = np.radians(70.0)
_STARTS, _STEPS = 2000, 40
_RECORD_TIMEOUT = 900.0


@dataclass(frozen=True, eq=False)
class InSockets:
    """Balls of a robot, in computation, at joint positions where they were in two sockets."""

    away: FloatArray  #: ``(n,)`` distances from the mean of each socket [m]
    apart: float  #: of the means [m]

    @classmethod
    def of(cls, robot: Robot, rows: Sequence[FloatArray]) -> InSockets:
        """Those of a robot whose end effector is the ball, at ``(n, dof)`` in each socket."""
        balls = [robot.forward_kinematics.poses(one)[:, :3] for one in rows]
        means = [ball.mean(axis=0) for ball in balls]
        away = [
            np.linalg.norm(ball - mean, axis=1) for ball, mean in zip(balls, means, strict=True)
        ]
        return cls(np.concatenate(away), float(np.linalg.norm(means[0] - means[1])))


def run_learn_sockets(folder: Path, rows: int, console: Console) -> str:
    """Run the demonstration.

    Args:
        folder: for ``arm.yaml`` and its URDF, ``sockets/``, ``held_out/``, ``nominal.onnx``,
            ``learned.onnx`` and its URDF, the report of the calibration ``calibration/``, the bags
            and reports ``nominal/`` and ``learned/``, ``before_and_after.png``, ``results.json``
            and ``logs/``.
        rows: number of configurations of the joints in each socket.
        console: for progress messages.

    Returns:
        Where the results are.

    Raises:
        AnnikError: if a part fails; names it and shows the end of its log.
    """
    with emptied(folder) as logs:
        arm = write_arm(folder)
        simulated = simulated_arm(arm)
        sockets = folder / "sockets", folder / "held_out"
        with console.status("recording by hand"):
            record(sockets[0], logs, arm, simulated, _PLACES, rows)
            held_out = record(sockets[1], logs, arm, simulated, [_HELD_OUT], rows)
        console.print(f"recorded {rows} rows in each of {2 * len(_PLACES) + 2} sockets")
        fit = _calibrate(folder, logs, arm, console)
        nominal, model = folder / "nominal.onnx", folder / "learned.onnx"
        targets = folder / "targets.csv"
        write_targets(load_robot(arm), targets)
        before_and_after = {}
        results: dict[str, Any] = {"fit": fit}
        for name, path in (("nominal", nominal), ("learned", model)):
            report = drive_along(name, str(path), simulated, targets, folder, logs, console)
            held = InSockets.of(
                load_model(path).robot, [np.loadtxt(file, delimiter=",") for file in held_out]
            )
            along = errors_of_path(report)
            before_and_after[name] = held, along
            results[name] = _summary(held, along, report)
            console.print(
                f"{name} model: balls of a socket {1e3 * held.away.mean():.3f} mm from their "
                f"mean, path {1e3 * along.mean():.3f} mm off"
            )
        figure = folder / "before_and_after.png"
        text = json.dumps(results, indent=2) + "\n"
        write_files_atomically(
            folder, {figure.name: comparison(before_and_after), "results.json": text.encode()}
        )
    return f"before and after: {figure}"


def simulated_arm(arm: Path) -> dict[str, object]:
    """The parameters of ``fake_robot``."""
    seed = {"imperfection_seed": ROBOT_SEED, "joint_compliance": _COMPLIANCE}
    return {"robot": arm, **seed}


def write_arm(folder: Path) -> Path:
    """The arm with a ball at its flange, as described; returns the file of its definition."""
    arm = load_robot(ROBOT)
    definition = dict(arm.definition)
    ball = (
        f'<joint name="ball" type="fixed"><parent link="{arm.end_effector_frame}"/>'
        f'<child link="ball_link"/><origin xyz="{_BALL}"/></joint><link name="ball_link"/></robot>'
    )
    definition["urdf"] = definition["urdf"].replace("</robot>", ball)
    definition |= {"name": f"{arm.name} with a ball", "end_effector_frame": "ball_link"}
    path = folder / "arm.yaml"
    # JSON is YAML.
    write_file(path, json.dumps(definition))
    return path


def record(
    folder: Path,
    logs: Path,
    arm: Path,
    simulated: dict[str, object],
    places: Sequence[tuple[float, float, float, float]],
    rows: int,
) -> list[Path]:
    """Record rows by hand in both sockets at some places; returns the files, two for each."""
    robot = load_robot(arm)
    files: list[Path] = []
    with processes(logs) as started:
        fake_robot = started.node(
            f"{folder.name}_fake_robot",
            "annik_ros.fake_robot.node",
            joint_state_rate=MEASUREMENT_RATE,
            **simulated,
        )
        fake_robot.wait_for_text("fake robot ", START_TIMEOUT)
        for number, (*place, direction) in enumerate(places):
            across = _SOCKET_DISTANCE * np.array([np.cos(direction), np.sin(direction), 0.0])
            for hole in range(2):
                files.append(folder / f"placement_{number}" / f"hole_{hole}.csv")
                name = f"{folder.name}_{number}_{hole}"
                guided = logs / f"{name}.csv"
                positions = guided_positions(robot, place + hole * across, rows, seed=len(files))
                np.savetxt(guided, positions, delimiter=",")
                hand = ["-m", "examples.hand", str(arm), str(guided)]
                # First: a collector that finds the arm in the previous socket could record it.
                started.start(f"{name}_first", hand).wait(_RECORD_TIMEOUT)
                collector = started.node(
                    f"{name}_collector",
                    "annik_ros.example_collector.node",
                    robot=arm,
                    by_hand=files[-1],
                    settle_time=0.05,
                    measurement_timeout=10.0,
                )
                collector.wait_for_text("guided by hand", START_TIMEOUT)
                started.start(f"{name}_hand", [*hand, str(files[-1])]).wait(_RECORD_TIMEOUT)
                collector.interrupt(END_TIMEOUT)
        fake_robot.interrupt(END_TIMEOUT)
    return files


def real_kinematics(robot: Robot) -> ForwardKinematics:
    """The forward kinematics of the simulated arm."""
    magnitudes = ImperfectionMagnitudes(joint_compliance=_COMPLIANCE)
    return imperfect_kinematics(robot, random_imperfections(robot, ROBOT_SEED, magnitudes))


def guided_positions(robot: Robot, socket: FloatArray, count: int, seed: int) -> FloatArray:
    """Joint positions ``(count, dof)`` in the joint box with the real arm's ball in a socket.

    Raises:
        AnnikError: if the socket is out of reach.
    """
    real = real_kinematics(robot)
    rng = np.random.default_rng([ROBOT_SEED, seed])
    joint_positions = robot.joint_box.sample(_STARTS, rng)
    wanted = socket + rng.normal(0.0, _PLAY, (_STARTS, 3))
    for _ in range(_STEPS):
        away = wanted - real.poses(joint_positions)[:, :3]
        steps = np.linalg.pinv(real.jacobians(joint_positions)[:, :3]) @ away[..., np.newaxis]
        joint_positions = joint_positions + np.clip(steps[..., 0], -0.2, 0.2)
    poses = real.poses(joint_positions)
    there = np.linalg.norm(poses[:, :3] - wanted, axis=1) < 1e-7
    upright = Rotation.from_quat(poses[:, 3:]).as_matrix()[:, 2, 2] < -np.cos(_MOST_TILT)
    box = robot.joint_box
    inside = ((joint_positions >= box.lower) & (joint_positions <= box.upper)).all(axis=1)
    found = joint_positions[there & upright & inside]
    if len(found) < count:
        raise AnnikError(
            f"the arm can be guided to a socket at {socket} in {len(found)} ways only"
        )
    return found[:count]


def _calibrate(folder: Path, logs: Path, arm: Path, console: Console) -> dict[str, Any]:
    """Calibrate, and train models of the robot as described and of the calibrated one."""
    summary = folder / "fit.json"
    with console.status("calibrating the robot"), processes(logs) as started:
        started.annik(
            "nominal", "train", "--robot", str(arm), "--out", str(folder / "nominal.onnx")
        ).wait(FIT_TIMEOUT)
        started.annik(
            "calibrate",
            *("calibrate", "--robot", str(arm), "--sockets", str(folder / "sockets")),
            *("--socket-distance", str(_SOCKET_DISTANCE), "--tool-known"),
            *("--out", str(folder / "learned.onnx"), "--urdf-out", str(folder / "learned.urdf")),
            *("--report", str(folder / "calibration"), "--summary", str(summary)),
        ).wait(FIT_TIMEOUT)
    fit: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    console.print(f"calibrated {', '.join(fit['parts'])} in {fit['seconds']:.1f} s")
    return fit


def errors_of_path(report: TrackingReport) -> FloatArray:
    """How far ``(n,)`` a path is from its targets [m] after the motion that brings it nearest."""
    targets = np.array([target.target for target in report.targets])
    achieved = np.array([target.achieved for target in report.targets])
    centres = targets.mean(axis=0), achieved.mean(axis=0)
    turn = Rotation.align_vectors(targets - centres[0], achieved - centres[1])[0]
    moved = turn.apply(achieved - centres[1]) + centres[0]
    return np.asarray(np.linalg.norm(moved - targets, axis=1))


def _summary(held: InSockets, along: FloatArray, report: TrackingReport) -> dict[str, Any]:
    """In mm."""
    return {
        "sockets_mm": {"mean": 1e3 * held.away.mean(), "max": 1e3 * held.away.max()},
        "distance_error_mm": 1e3 * abs(held.apart - _SOCKET_DISTANCE),
        "path_mm": {"mean": 1e3 * along.mean(), "max": 1e3 * along.max()},
        "targets_sent": report.targets_sent,
        "targets_answered": report.targets_answered,
    }


def comparison(before_and_after: Mapping[str, tuple[InSockets, FloatArray]]) -> bytes:
    """Both errors of both models, by name, as PNG with logarithmic axes."""
    figure = Figure(figsize=(11.0, 5.4), dpi=120, layout="constrained")
    upper, lower = figure.subplots(2, 1)
    for (name, (held, along)), (colour, line) in zip(
        before_and_after.items(), STYLES, strict=True
    ):
        for axes, errors, style in ((upper, held.away, "o"), (lower, along, line)):
            label = f"{name}: mean {1e3 * errors.mean():.3g} mm"
            axes.plot(
                np.arange(1, len(errors) + 1), 1e3 * errors, style, color=colour, label=label
            )
    for axes, title, label in (
        (upper, "ball in two sockets that were left out: distance from its mean", "row"),
        (lower, "ball along a path: distance from it, after its best motion", "target"),
    ):
        axes.set(title=title, xlabel=label, ylabel="error [mm]", yscale="log")
        axes.grid(visible=True, which="both", alpha=0.3)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return png(figure)
