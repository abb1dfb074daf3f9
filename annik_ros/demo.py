"""The whole of annik in one command: train, serve, drive the fake robot, record, report.

Each part runs as its user would run it, in a process of its own: the ``annik`` command line for
the training, the four nodes over DDS. Training is not imported here, since what drives a robot
does not need torch.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from rich.console import Console

from annik_core.atomic_write import write_files_atomically
from annik_core.errors import AnnikError
from annik_ros.child_process import ChildProcess, end_all, wait_until
from msg_tools.bag_reader import read_bag
from msg_tools.report import write_report
from msg_tools.report_table import print_report
from msg_tools.topics import ORIENTATION_ERROR, POSITION_ERROR

#: Every 2 mm of the paper's diagonal; each tenth is one of its 15 points.
POINTS = 141
RATE = 50.0
STEPS = 6

#: Its presence says that the folder may be emptied.
_MARKER = ".annik_demo"
_START_TIMEOUT = 30.0
_END_TIMEOUT = 10.0
_TRAINING_TIMEOUT = 600.0


def run_demo(folder: Path, console: Console) -> dict[str, Any]:
    """Run the demo and leave everything it makes in a folder.

    Args:
        folder: gets ``model.onnx``, ``bag/``, ``report.html``, pictures, ``results.json`` and the
            ``logs/`` of the processes. What an earlier demo left there is removed.
        console: told of the progress.

    Returns:
        What is in ``results.json``.

    Raises:
        AnnikError: if a part fails; names it and shows the end of its log.
    """
    _empty(folder)
    logs = folder / "logs"
    logs.mkdir(parents=True)
    model, bag = folder / "model.onnx", folder / "bag"
    training = _train(model, logs, console)
    _drive(model, bag, logs, console)
    console.print("reporting")
    report = write_report(bag, folder)
    print_report(report, console)
    results = {**report.results(), "training": training}
    text = json.dumps(results, indent=2) + "\n"
    write_files_atomically(folder, {"results.json": text.encode()})
    return results


def _train(model: Path, logs: Path, console: Console) -> dict[str, Any]:
    summary = model.with_name("training.json")
    command = [
        *_python("annik_training.cli"),
        *("train", "--robot", "gantry", "--design", "thirty_phase", "--steps", str(STEPS)),
        *("--out", str(model), "--summary", str(summary)),
    ]
    with (
        console.status("training on the paper's 30-phase design"),
        ChildProcess(command, logs / "train.log", os.environ) as process,
    ):
        process.wait(_TRAINING_TIMEOUT)
    training: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    console.print(f"trained on {training['examples']} examples in {training['seconds']:.1f} s")
    return training


def _drive(model: Path, bag: Path, logs: Path, console: Console) -> None:
    environment = {
        **os.environ,
        # The demo commands a robot: it must not be heard by a real one on the network.
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    }

    def node(name: str, module: str, **parameters: object) -> ChildProcess:
        arguments = [f"{key}:={value}" for key, value in parameters.items()]
        flags = [text for argument in arguments for text in ("-p", argument)]
        command = [*_python(module), "--ros-args", *flags]
        return stack.enter_context(ChildProcess(command, logs / f"{name}.log", environment))

    console.print(f"driving the fake robot along {POINTS} targets of the paper's diagonal")
    with ExitStack() as stack:
        robot = node("fake_robot", "annik_ros.fake_robot_node", model=model)
        recorder = node("bag_recorder", "annik_ros.bag_recorder", output=bag)
        # A controller wants the newest target; a measurement wants all of them.
        solver = node("ik_node", "annik_ros.ik_node", model=model, queue_depth=100)
        robot.wait_for_text("joint_command -> joint_states", _START_TIMEOUT)
        solver.wait_for_text("target_pose -> joint_command", _START_TIMEOUT)
        recorder.wait_for_text("recording ", _START_TIMEOUT)
        publisher = node(
            "target_publisher",
            "annik_ros.target_publisher",
            path="diagonal",
            points=POINTS,
            rate=RATE,
            wait_for_subscribers=2,
        )
        publisher.wait(_START_TIMEOUT + POINTS / RATE + _END_TIMEOUT)
        wait_until(lambda: _recorded_errors(bag) >= POINTS, _END_TIMEOUT, period=0.2)
        for process in (recorder, robot, solver):
            process.interrupt(_END_TIMEOUT)


def _recorded_errors(bag: Path) -> int:
    """How many targets the bag, still being written, holds both errors of."""
    topics = read_bag(bag).topics
    names = (f"/{topic.name}" for topic in (POSITION_ERROR, ORIENTATION_ERROR))
    return min(topics[name].message_count if name in topics else 0 for name in names)


def _python(module: str) -> list[str]:
    return [sys.executable, "-m", module]


def _empty(folder: Path) -> None:
    """Make the folder, or empty it if an earlier demo made it; never delete anything else."""
    marker = folder / _MARKER
    try:
        if folder.exists() and any(folder.iterdir()):
            if not marker.is_file():
                raise AnnikError(
                    f"{folder} is not the folder of a demo: remove it, or give --out another"
                )
            shutil.rmtree(folder)
        folder.mkdir(parents=True, exist_ok=True)
        marker.touch()
    except OSError as error:
        raise AnnikError(f"{folder} can't be emptied: {error.strerror}") from error


def _on_termination(signal_number: int, frame: FrameType | None) -> NoReturn:
    # An exception, so that the processes started are ended on the way out.
    raise SystemExit(128 + signal_number)


def main() -> int:
    """Run the demo; returns the exit code."""
    parser = argparse.ArgumentParser(description="Train, serve, drive, record and report.")
    parser.add_argument("--out", type=Path, default=Path("build/demo"), help="folder to fill")
    folder = parser.parse_args().out
    console = Console()
    # A shell that starts the demo in the background has SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _on_termination)
    try:
        run_demo(folder, console)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except AnnikError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1
    finally:
        end_all()
    console.print(f"report: {folder / 'report.html'}   bag: {folder / 'bag'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
