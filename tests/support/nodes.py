"""Nodes of annik as processes, for the tests over real DDS.

Every test gets a domain of its own on the loopback interface, and every process that it started is
killed with its whole group when it ends, passed or failed.
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import onnx
import pytest

from annik_core.installation import default_model_path
from annik_core.model.artifact import load_model
from annik_core.robots.library import robot_from_definition
from examples.demonstration import reserved_domain
from support.forked import ForkedNode
from support.processes import Process

#: What a node logs once it is ready.
READY_TEXTS = {
    "bag_recorder": "recording ",
    "example_collector": " are measured: ",
    "ik_node": "serving ",
    "fake_robot": "fake robot ",
    "target_publisher": "subscriber(s)",
    "viewer": "showing ",
}


class NodeProcess(Process):
    """A node of annik in a process of its own.

    Args:
        node: its name, a folder of ``annik_ros``.
        arguments: ROS arguments, after ``--ros-args``.
        domain: ROS domain.
        log: file for its output, or a device.
        environment: variables to set besides those of the test.
        own_interpreter: start an interpreter, which takes longer, also without other options.
        options: see :class:`Process`.
    """

    def __init__(
        self,
        node: str,
        arguments: tuple[str, ...],
        domain: int,
        log: Path,
        environment: Mapping[str, str] | None = None,
        own_interpreter: bool = False,
        **options: object,
    ) -> None:
        self.node = node
        if arguments:
            arguments = ("--ros-args", *arguments)
        if not (own_interpreter or environment or options):
            self.name, self._log = log.stem, log
            self._process = ForkedNode(node, arguments, log, domain)
            return
        command = [sys.executable, "-m", f"annik_ros.{node}.node", *arguments]
        environment = {"ROS_DOMAIN_ID": str(domain), **(environment or {})}
        super().__init__(*command, log=log, environment=environment, **options)

    def wait_until_ready(self) -> None:
        """Wait for the line that says so."""
        self.wait_for_text(READY_TEXTS[self.node])


@pytest.fixture
def domain() -> Iterator[int]:
    """The ROS domain of the test."""
    with reserved_domain() as domain:
        yield domain


@pytest.fixture
def launch(domain: int, tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start a node: ``launch(node, *ros_arguments)``; waits until it is ready unless told not to.

    ``log``: where its output goes, if not into a file of the test; other options:
    :class:`NodeProcess`.
    """
    processes: list[NodeProcess] = []

    def start(
        node: str, *arguments: str, ready: bool = True, log: Path | None = None, **options: object
    ) -> NodeProcess:
        log = log or tmp_path / f"{len(processes)}_{node}.log"
        processes.append(NodeProcess(node, arguments, domain, log, **options))
        if ready:
            processes[-1].wait_until_ready()
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        print(f"--- {process.node} ---\n{process.log}")


@pytest.fixture
def other_robots_model(tmp_path: Path) -> Path:
    """A sound model file of a robot that is the gantry but for the names of its joints."""
    model = onnx.load(default_model_path())
    definition = copy.deepcopy(dict(load_model(default_model_path()).metadata.robot))
    definition["name"] = "other"
    for joint in definition["joints"]:
        joint["name"] = f"other_{joint['name']}"
    robot = robot_from_definition(definition, "the test's")
    changed = {
        "annik.robot": definition,
        "annik.robot_hash": robot.definition_hash,
        "annik.joint_names": list(robot.joint_names),
    }
    for entry in model.metadata_props:
        if entry.key in changed:
            entry.value = json.dumps(changed[entry.key])
    path = tmp_path / "other.onnx"
    onnx.save(model, path)
    return path
