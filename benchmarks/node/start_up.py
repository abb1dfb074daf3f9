"""From the start of a node's process to its first command."""

from __future__ import annotations

import compileall
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import median

import numpy as np

import annik_core
import annik_ros
import benchmarks
import msg_tools
from benchmarks.node.client import CONNECT_TIMEOUT, Client
from benchmarks.node.nodes import NodeVariant
from benchmarks.node.results import StartResult
from benchmarks.node.targets import solvable_targets

#: Period at which the waiting client repeats its target [s].
_PERIOD = 0.02
#: Time for the client's endpoints to appear and for those of the node before to go [s].
_PAUSE = 0.5


def measure_starts(
    client: Client,
    variants: Sequence[NodeVariant],
    starts: int,
    logs: Path,
    rng: np.random.Generator,
) -> list[StartResult]:
    """Start every node several times, in turn.

    Args:
        client: waits for the first command.
        variants: the nodes.
        starts: how often.
        logs: existing folder for what they print.
        rng: draws the target.

    Raises:
        NoCommand: if no command of a node arrives.
    """
    # As an installation does. Otherwise each start might compile the modules of annik anew, while
    # the null node has few.
    for package in (annik_core, annik_ros, benchmarks, msg_tools):
        compileall.compile_dir(package.__path__[0], quiet=1)
    times: dict[NodeVariant, list[float]] = {variant: [] for variant in variants}
    target = {
        variant: solvable_targets(variant.model or "gantry", 1, rng)[0] for variant in variants
    }
    for number in range(starts):
        for index, variant in enumerate(variants):
            taken = _first_command(
                client, variant, f"/start_{number}_{index}", target[variant], logs
            )
            times[variant].append(taken)
    return [
        StartResult(variant.name, starts, min(found), median(found), max(found))
        for variant, found in times.items()
    ]


def _first_command(
    client: Client, variant: NodeVariant, namespace: str, target: bytes, logs: Path
) -> float:
    """Time from the start of the process to its first command [s]."""
    link = client.link(namespace)
    try:
        client.spin_for(_PAUSE)
        begin = time.perf_counter()
        with variant.start(namespace, logs):
            client.wait_for_first(link, target, _PERIOD, CONNECT_TIMEOUT)
            return link.arrival - begin
    finally:
        link.destroy()
