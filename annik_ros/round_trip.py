"""Start an ik_node, send it a target, and wait for the command."""

from __future__ import annotations

import os
import tempfile
import time
from contextlib import closing
from pathlib import Path
from statistics import median

from annik_core.model.artifact import load_model
from benchmarks.node.client import Client, NoAnswer
from benchmarks.node.nodes import NodeVariant
from benchmarks.node.targets import pose_to_bytes

#: Longest wait for a command [s]; a loaded machine is slow to start Python.
TIMEOUT = 20.0
#: Time between two targets until the first command arrives [s]: who is not yet discovered misses
#: what is sent.
_PERIOD = 0.05
_TRIPS = 20


def round_trip(model: Path) -> tuple[float, float]:
    """Ask an ik_node of its own, in a namespace that nobody else uses.

    Args:
        model: the model file that it serves.

    Returns:
        Time from the start of its process to its first command, and from a target to its command
        once they have met, the median of some [s].

    Raises:
        NoAnswer: if no command arrives within :data:`TIMEOUT`.
    """
    namespace = f"/annik_doctor_{os.getpid()}"
    robot = load_model(model).robot
    target = pose_to_bytes(robot.forward_kinematics.poses(robot.joint_box.centre[None])[0])
    with closing(Client()) as client, tempfile.TemporaryDirectory() as folder:
        link = client.link(namespace)
        begin = time.perf_counter()
        with NodeVariant("ik_node", model=str(model)).start(namespace, Path(folder)):
            client.wait_for_first(link, target, _PERIOD, TIMEOUT)
            start = link.arrival - begin
            # What was sent too often is answered too.
            client.quiet(link)
            trips = [client.ask(link, target, TIMEOUT) for _ in range(_TRIPS)]
    answered = [trip for trip in trips if trip is not None]
    if len(answered) < _TRIPS:
        raise NoAnswer(namespace, TIMEOUT)
    return start, median(answered)
