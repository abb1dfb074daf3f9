"""The nodes that are compared, as processes."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from annik_ros.parameters import ExecutorChoice
from annik_ros.processes import ChildProcess

NULL = "null_node"
_COMMANDS = {"ik_node": ("annik_ros.main", "ik_node"), NULL: ("benchmarks.node.null_node",)}


@dataclass(frozen=True)
class NodeVariant:
    """A node with its parameters.

    Attributes:
        program: ``ik_node`` or ``null_node``.
        executor: the one of rclpy that it uses.
        model: of an ``ik_node``: the packaged model; empty for the null node.
        queue_depth: number of targets that may wait.
        marked: of a null node: whether its commands say to which target they belong.
    """

    program: str
    executor: str = ExecutorChoice.EVENTS.value
    model: str = ""
    queue_depth: int = 1
    marked: bool = False

    @property
    def name(self) -> str:
        """Program and model, such as ``ik_node gantry``."""
        return f"{self.program} {self.model}".strip().replace(NULL, "null node")

    @property
    def is_null(self) -> bool:
        """Whether it does nothing."""
        return self.program == NULL

    def start(self, namespace: str, logs: Path, remapped: str = "") -> ChildProcess:
        """Start it.

        Args:
            namespace: for all its topics, such as ``/null_1``.
            logs: existing folder for what it prints.
            remapped: topic of its targets, if not the one in its namespace.
        """
        parameters = {"executor": self.executor, "queue_depth": str(self.queue_depth)}
        if self.model:
            parameters["model"] = self.model
        if self.marked:
            parameters["marked"] = "true"
        command = [sys.executable, "-m", *_COMMANDS[self.program], "--ros-args"]
        command += ["-r", f"__ns:={namespace}"]
        if remapped:
            command += ["-r", f"target_pose:={remapped}"]
        for key, value in parameters.items():
            command += ["-p", f"{key}:={value}"]
        log = logs / f"{namespace.strip('/').replace('/', '_')}.log"
        return ChildProcess(command, log, os.environ)
