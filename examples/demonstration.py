"""Shared by the demonstrations: output folder, processes, signals, exit code."""

from __future__ import annotations

import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import click
from rich.console import Console

from annik_core.errors import AnnikError, InvalidValue, NotWritable
from annik_ros.processes import SIGNALS, ChildProcess, running
from annik_ros.shared_memory import remove_half_made
from msg_tools.bags.reader import read_bag
from msg_tools.topics import ORIENTATION_ERROR, POSITION_ERROR

#: Longest time that a node may take to start and to end [s]; a loaded machine is slow.
START_TIMEOUT = 120.0
END_TIMEOUT = 60.0
#: Time without a further result, after which no more are expected [s].
RESULT_TIMEOUT = 10.0

#: Domains that every platform supports, besides the default one.
_DOMAINS = 101
#: File that marks a folder which may be emptied.
_MARKER = ".annik_demo"


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End the program on SIGINT, SIGTERM and SIGHUP; end every process when it ends."""

    def end(number: int, _: FrameType | None) -> NoReturn:
        raise SystemExit(128 + number)

    # Also in a shell's background, where SIGINT is ignored.
    for number in SIGNALS:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        for process in tuple(running):
            process.end()


class ChildProcessFailed(AnnikError):
    """A process ended with an error, or did not reach the expected state in time."""

    def __init__(self, name: str, problem: str, log: Path) -> None:
        self.name = name
        self.problem = problem
        self.log = log
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()[-5:]
        super().__init__("\n".join([f"{name} {problem}; the end of {log}:", *lines]))


class WatchedProcess(ChildProcess):
    """A process whose output and end are waited for."""

    def __init__(self, command: Sequence[str], log: Path, environment: Mapping[str, str]) -> None:
        self.name = log.stem
        self.log = log
        super().__init__(command, log, environment)

    def wait_for_text(self, text: str, timeout: float) -> None:
        """Wait until the process has printed ``text``.

        Raises:
            ChildProcessFailed: if it ends first, or has not after ``timeout`` seconds.
        """
        printed = wait_until(
            lambda: text in self.log.read_text(encoding="utf-8", errors="replace"),
            timeout,
            lambda: self.process.poll() is None,
        )
        if not printed:
            self._fail(f"did not print {text!r} within {timeout:g} s")

    def wait(self, timeout: float) -> None:
        """Wait until the process has ended.

        Raises:
            ChildProcessFailed: if its exit code is not 0, or it goes on after ``timeout`` seconds.
        """
        try:
            code = self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._fail(f"did not end within {timeout:g} s")
        if code != 0:
            self._fail("failed")

    def interrupt(self, timeout: float) -> None:
        """End the process by SIGINT, as Ctrl-C does; otherwise as :meth:`wait`."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        self.wait(timeout)

    def _fail(self, problem: str) -> NoReturn:
        code = self.process.poll()
        ended = f" (it ended with exit code {code})" if code is not None else ""
        raise ChildProcessFailed(self.name, problem + ended, self.log)


def wait_until(
    condition: Callable[[], bool],
    timeout: float,
    worth_waiting: Callable[[], bool] = lambda: True,
    period: float = 0.02,
) -> bool:
    """Whether a condition, checked every ``period`` [s], comes true within ``timeout`` [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline or not worth_waiting():
            return condition()
        time.sleep(period)
    return True


@contextmanager
def reserved_domain() -> Iterator[int]:
    """A ROS domain that no other program has from here at the same time.

    What a process that was killed left half made there is removed: other nodes than annik's would
    wait for it.

    Raises:
        AnnikError: if all are taken.
    """
    for number in range(os.getpid(), os.getpid() + _DOMAINS):
        domain = 1 + number % _DOMAINS
        # A name without a file, which is free again when this process ends, however it ends.
        with socket.socket(socket.AF_UNIX) as name:
            try:
                name.bind(f"\0annik_ros_domain_{domain}")
            except OSError:
                continue
            remove_half_made(domain)
            yield domain
            return
    raise AnnikError(f"all ROS domains up to {_DOMAINS} are in use: wait until others have ended")


class Processes:
    """Starts processes with a log folder and a ROS domain of their own."""

    def __init__(self, logs: Path, stack: ExitStack) -> None:
        """Start processes that end with ``stack``."""
        self._logs = logs
        self._stack = stack
        self._environment = {
            **os.environ,
            # The commands must not reach a real robot on the network.
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": str(stack.enter_context(reserved_domain())),
        }

    def node(self, name: str, module: str, **parameters: object) -> WatchedProcess:
        """Start a node of annik with parameters."""
        arguments = [f"{key}:={value}" for key, value in parameters.items()]
        flags = [text for argument in arguments for text in ("-p", argument)]
        return self.start(name, ["-m", module, "--ros-args", *flags])

    def annik(self, name: str, *arguments: str) -> WatchedProcess:
        """Start the ``annik`` command line."""
        return self.start(name, ["-m", "annik_training.cli", *arguments])

    def start(self, name: str, arguments: Sequence[str]) -> WatchedProcess:
        """Start Python with arguments."""
        command = [sys.executable, *arguments]
        process = WatchedProcess(command, self._logs / f"{name}.log", self._environment)
        self._stack.enter_context(process)
        return process


@contextmanager
def processes(logs: Path) -> Iterator[Processes]:
    """Start processes that end with the context."""
    with ExitStack() as stack:
        yield Processes(logs, stack)


def drive(
    started: Processes,
    name: str,
    bag: Path,
    targets: int,
    rate: float,
    solver: dict[str, object],
    robot: dict[str, object],
    path: dict[str, object],
) -> None:
    """Let an ``ik_node`` drive a ``fake_robot`` along a path, and record it.

    Args:
        started: starts the four nodes.
        name: prefix of the names of their logs.
        bag: folder of the recording.
        targets: number of targets.
        rate: rate of the targets [Hz].
        solver: parameters of ``ik_node``.
        robot: parameters of ``fake_robot``.
        path: parameters of ``target_publisher``.

    Raises:
        ChildProcessFailed: naming the node.
    """
    fake_robot = started.node(f"{name}fake_robot", "annik_ros.fake_robot.node", **robot)
    recorder = started.node(f"{name}bag_recorder", "annik_ros.bag_recorder.node", output=bag)
    # A queue for all targets: the default keeps only the newest.
    ik_node = started.node(f"{name}ik_node", "annik_ros.ik_node.node", queue_depth=1000, **solver)
    fake_robot.wait_for_text("fake robot ", START_TIMEOUT)
    ik_node.wait_for_text("serving ", START_TIMEOUT)
    recorder.wait_for_text("recording ", START_TIMEOUT)
    publisher = started.node(
        f"{name}target_publisher",
        "annik_ros.target_publisher.node",
        rate=rate,
        wait_for_subscribers=2,
        **path,
    )
    publisher.wait(START_TIMEOUT + targets / rate + END_TIMEOUT)
    recorded = -1
    while recorded < targets:
        before, recorded = recorded, _recorded_errors(bag)
        if recorded == before:
            break  # the others were refused
        wait_until(lambda: _recorded_errors(bag) >= targets, RESULT_TIMEOUT, period=0.2)
    for process in (recorder, fake_robot, ik_node):
        process.interrupt(END_TIMEOUT)


@contextmanager
def emptied(folder: Path) -> Iterator[Path]:
    """Make a folder, or empty it if an earlier run made it; yields its folder for logs.

    Other demonstrations are kept out of it until the context ends.

    Raises:
        InvalidValue: if no earlier run made the folder, or another is using it.
        NotWritable: if it can't be emptied.
    """
    marker, logs = folder / _MARKER, folder / "logs"
    with ExitStack() as stack:
        try:
            if folder.exists() and any(folder.iterdir()) and not marker.is_file():
                raise InvalidValue("--out", str(folder), "no folder, or the folder of a demo")
            folder.mkdir(parents=True, exist_ok=True)
            # Released when the process ends, however it ends.
            fcntl.flock(stack.enter_context(marker.open("a")), fcntl.LOCK_EX | fcntl.LOCK_NB)
            for entry in folder.iterdir():
                if entry.is_dir() and not entry.is_symlink():
                    shutil.rmtree(entry)
                elif entry != marker:
                    entry.unlink()
            logs.mkdir()
        except BlockingIOError as error:
            allowed = "the folder of no other demo that is running"
            raise InvalidValue("--out", str(folder), allowed) from error
        except OSError as error:
            reason = error.strerror or str(error)
            raise NotWritable(folder, reason, "give --out another folder") from error
        yield logs


def out_option(folder: str) -> Callable[[Any], Any]:
    """The option ``--out`` of a demonstration, with its default."""
    return click.option(
        "--out",
        # Complete, so that it means the same to every process.
        type=click.Path(path_type=Path, resolve_path=True),
        default=Path(folder),
        show_default=True,
        help="Folder for everything that it makes.",
    )


def run_demonstration(name: str, run: Callable[[Console], str]) -> NoReturn:
    """Run a demonstration as a program, and exit.

    Args:
        name: name in an error message.
        run: prints progress to the console, and returns where the results are.
    """
    console = Console()
    with ended_by_signals():
        try:
            result = run(console)
        except AnnikError as error:
            print(f"{name}: {error}", file=sys.stderr)
            sys.exit(1)
    console.print(result)
    sys.exit(0)


def _recorded_errors(bag: Path) -> int:
    """Number of targets of which the bag, still being written, has both errors."""
    topics = read_bag(bag).topics
    names = (f"/{topic.name}" for topic in (POSITION_ERROR, ORIENTATION_ERROR))
    return min(topics[name].message_count if name in topics else 0 for name in names)
