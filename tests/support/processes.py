"""Processes of tests: each in a group of its own, which ends with the test. ROS-free."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: How long anything may take before a test fails [s]. A wait ends as soon as its condition holds,
#: so that only a failure takes this long; a loaded machine is slow to start Python.
PATIENCE = 180.0
#: From the signal that ends a node to its end, 0.3 s on an idle machine [s].
EXIT_PATIENCE = 15.0
#: For what trains, fits or builds [s].
LONG_PATIENCE = 10 * PATIENCE

_POLL_PERIOD = 0.02


def wait_until(condition: Callable[[], object], what: str, patience: float = PATIENCE) -> None:
    """Wait until a condition holds; fail, naming what was waited for, if it takes too long."""
    deadline = time.monotonic() + patience
    while not condition():
        if time.monotonic() > deadline:
            pytest.fail(f"waited {patience:g} s in vain: {what}")
        time.sleep(_POLL_PERIOD)


def is_group_gone(group: int) -> bool:
    """Whether a process group has no process left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


def run_python(
    *arguments: object,
    cwd: Path = ROOT,
    environment: Mapping[str, str] | None = None,
    patience: float = PATIENCE,
) -> subprocess.CompletedProcess[str]:
    """Run this interpreter to its end.

    Args:
        arguments: command line after the interpreter.
        cwd: working directory.
        environment: variables to set besides those of the test.
        patience: longest time that it may take [s].

    Returns:
        Exit code, standard output and standard error.
    """
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=patience,
        check=False,
    )


class Process:
    """A process in a group of its own, and what it prints.

    Args:
        command: program and arguments.
        log: file for standard output and standard error, or a device.
        cwd: working directory.
        environment: variables to set besides those of the test.
        file_size_limit: largest file that it may write [bytes].
    """

    def __init__(
        self,
        *command: str,
        log: Path,
        cwd: Path = ROOT,
        environment: Mapping[str, str] | None = None,
        file_size_limit: int | None = None,
    ) -> None:
        self.name = log.stem
        self._log = log

        def prepare() -> None:
            # A background shell that runs the tests has it ignored.
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            if file_size_limit is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (file_size_limit, file_size_limit))

        with log.open("wb") as output:
            self._process = subprocess.Popen(
                command,
                cwd=cwd,
                env={**os.environ, **(environment or {})},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=prepare,
            )

    @property
    def pid(self) -> int:
        """The number of the process and of its group."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    @property
    def log(self) -> str:
        """Everything that it has printed so far; nothing if that went to a device."""
        if not self._log.is_file():
            return ""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def wait_for_text(self, text: str, count: int = 1) -> None:
        """Wait until it has printed a text so many times; fail if it ends before."""
        # Ended is looked at before the log is read, so that last words are not missed.
        wait_until(
            lambda: not self.is_running or self.log.count(text) >= count,
            f"{text!r} from {self.name}",
        )
        if self.log.count(text) < count:
            pytest.fail(f"{self.name} ended without {text!r}:\n{self.log}")

    def wait_for_exit(self, patience: float = PATIENCE) -> int:
        """Its exit code; fail if it does not end."""
        try:
            return self._process.wait(patience)
        except subprocess.TimeoutExpired:
            pytest.fail(f"{self.name} still runs after {patience:g} s:\n{self.log}")

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def signal_group(self, number: int) -> None:
        """Send a signal to it and everything that it started, as a terminal does."""
        os.killpg(self.pid, number)

    def kill(self) -> None:
        """Kill it and everything that it started."""
        with contextlib.suppress(ProcessLookupError):
            self.signal_group(signal.SIGKILL)
        self._process.wait()
