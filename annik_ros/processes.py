"""Child processes with their output in a file; each ends with its whole process group."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import NoReturn

from annik_core.errors import AnnikError

_POLL_PERIOD = 0.02
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_running: list[ChildProcess] = []


class ChildProcessFailed(AnnikError):
    """A process ended with an error, or did not reach the expected state in time."""

    def __init__(self, name: str, problem: str, log: Path) -> None:
        self.name = name
        self.problem = problem
        self.log = log
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()[-5:]
        super().__init__("\n".join([f"{name} {problem}; the end of {log}:", *lines]))


class ChildProcess:
    """A process in a group of its own; leaving the context ends the whole group."""

    def __init__(self, command: Sequence[str], log: Path, environment: Mapping[str, str]) -> None:
        self.name = log.stem
        self._log = log
        with log.open("wb") as output, _signals_deferred():
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=dict(environment),
                start_new_session=True,
            )
            _running.append(self)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    def __enter__(self) -> ChildProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def wait_for_text(self, text: str, timeout: float) -> None:
        """Wait until the process has printed ``text``.

        Raises:
            ChildProcessFailed: if it ends first, or has not after ``timeout`` seconds.
        """
        printed = wait_until(
            lambda: text in self._log.read_text(encoding="utf-8", errors="replace"),
            timeout,
            lambda: self._process.poll() is None,
        )
        if not printed:
            self._fail(f"did not print {text!r} within {timeout:g} s")

    def wait(self, timeout: float) -> None:
        """Wait until the process has ended.

        Raises:
            ChildProcessFailed: if its exit code is not 0, or it goes on after ``timeout`` seconds.
        """
        try:
            code = self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            self._fail(f"did not end within {timeout:g} s")
        if code != 0:
            self._fail("failed")

    def interrupt(self, timeout: float) -> None:
        """End the process by SIGINT, as Ctrl-C does; otherwise as :meth:`wait`."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        self.wait(timeout)

    def _fail(self, problem: str) -> NoReturn:
        code = self._process.poll()
        ended = f" (it ended with exit code {code})" if code is not None else ""
        raise ChildProcessFailed(self.name, problem + ended, self._log)

    def end(self) -> None:
        """End the process group: by SIGTERM, then by SIGKILL."""
        for signal_number in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(self._process.pid, signal_number)
                self._process.wait(3.0)
            except (ProcessLookupError, PermissionError):
                break
            except subprocess.TimeoutExpired:
                continue
        self._process.wait()
        if self in _running:
            _running.remove(self)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End the program on SIGINT, SIGTERM and SIGHUP; end every process when it ends."""

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise SystemExit(128 + number)

    # Also in a shell's background, where SIGINT is ignored.
    for number in _SIGNALS:
        signal.signal(number, end)
    try:
        yield
    finally:
        for process in tuple(_running):
            process.end()


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Defer SIGINT, SIGTERM and SIGHUP: during a start, the process would be lost."""
    received: list[int] = []
    handlers = {number: signal.getsignal(number) for number in _SIGNALS}
    for number in _SIGNALS:
        signal.signal(number, lambda number, frame: received.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for received_number in received:
            signal.raise_signal(received_number)


def wait_until(
    condition: Callable[[], bool],
    timeout: float,
    worth_waiting: Callable[[], bool] = lambda: True,
    period: float = _POLL_PERIOD,
) -> bool:
    """Whether a condition, checked every ``period`` [s], comes true within ``timeout`` [s]."""
    deadline = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > deadline or not worth_waiting():
            return condition()
        time.sleep(period)
    return True
