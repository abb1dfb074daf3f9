"""Nodes forked from a process that has loaded their modules: to load them again takes the longest.

This module is loaded in each of them, so it imports little.
"""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path

_SERVER = multiprocessing.get_context("forkserver")
_SERVER.set_forkserver_preload(
    [
        "support.forked",
        "onnxruntime",
        "scipy.spatial.transform",
        *(
            f"annik_ros.{node}.node"
            for node in ("ik_node", "fake_robot", "target_publisher", "example_collector")
        ),
    ]
)


class ForkedNode:
    """A running node, with the methods of ``subprocess.Popen`` that are needed.

    Args:
        node: its name.
        arguments: its command line.
        log: file for standard output and standard error, or a device.
        domain: ROS domain.
    """

    def __init__(self, node: str, arguments: tuple[str, ...], log: Path, domain: int) -> None:
        # What is left of an earlier node is not this one's.
        log.open("wb").close()
        self._process = _SERVER.Process(
            target=_run, args=(node, arguments, str(log), domain), daemon=True
        )
        self._process.start()
        self.pid = self._process.pid
        # To be signalled it needs its group. It may have ended already.
        with suppress(ProcessLookupError):
            while self.poll() is None and os.getpgid(self.pid) != self.pid:
                time.sleep(1e-3)

    def poll(self) -> int | None:
        """The exit code, or None while it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """The exit code."""
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(self._process.name, timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal, if it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)


def _run(node: str, arguments: tuple[str, ...], log: str, domain: int) -> None:
    os.setsid()
    for path, flags, descriptors in (
        (os.devnull, os.O_RDONLY, (0,)),
        (log, os.O_WRONLY | os.O_APPEND, (1, 2)),
    ):
        opened = os.open(path, flags)
        for descriptor in descriptors:
            os.dup2(opened, descriptor)
        os.close(opened)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    module = import_module(f"annik_ros.{node}.node")
    sys.argv = [str(module.__file__), *arguments]
    sys.exit(module.main())
