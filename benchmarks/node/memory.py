"""Memory of both nodes over time, with targets at 1 kHz from the same publisher."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from annik_core.robots.library import load_robot
from benchmarks.node.client import Client, no_garbage_collection
from benchmarks.node.nodes import NULL, NodeVariant
from benchmarks.node.process_usage import resident_megabytes
from benchmarks.node.results import MemoryResult
from benchmarks.node.streams import start_prelude
from benchmarks.node.target_stream import Stream, TargetStreams
from benchmarks.node.targets import pose_to_bytes, random_poses

RATE = 1000.0
_VARIANTS = (NodeVariant("ik_node", model="gantry"), NodeVariant(NULL))
_TOPIC = "/memory/target_pose"
#: Number of different targets.
_TARGETS = 20_000
#: Number of samples of the memory.
_SAMPLES = 120


def measure_memory(
    client: Client,
    streams: TargetStreams,
    warm_up: float,
    minutes: float,
    logs: Path,
    rng: np.random.Generator,
) -> list[MemoryResult]:
    """Watch the memory of an ``ik_node`` for the gantry and of a null node.

    Args:
        client: takes the commands.
        streams: publishes the targets.
        warm_up: time before the first sample [s].
        minutes: time from there to the last sample [min].
        logs: existing folder for what the nodes print.
        rng: draws the targets.

    Raises:
        NoCommand: if no command of a node arrives.
    """
    poses = random_poses(load_robot("gantry"), _TARGETS, rng)
    targets = [pose_to_bytes(pose) for pose in poses]
    count = int(RATE * (warm_up + 60.0 * minutes))
    with ExitStack() as stack:
        links = [client.link(f"/memory_{index}") for index in range(len(_VARIANTS))]
        for link in links:
            stack.callback(link.destroy)
        processes = [
            stack.enter_context(variant.start(link.namespace, logs, _TOPIC))
            for variant, link in zip(_VARIANTS, links, strict=True)
        ]
        start_prelude(client, streams, Stream(_TOPIC, RATE, count, targets, targets[0]), links)
        stack.enter_context(no_garbage_collection())
        streams.go()
        client.spin_for(warm_up)
        before = [link.received for link in links]
        samples = [[resident_megabytes(process.pid)] for process in processes]
        while not streams.ended:
            client.spin_for(60.0 * minutes / _SAMPLES)
            for process, found in zip(processes, samples, strict=True):
                found.append(resident_megabytes(process.pid))
        streams.times()
        for link in links:
            client.quiet(link)
        return [
            _result(variant, minutes, link.received - earlier, found)
            for variant, link, earlier, found in zip(
                _VARIANTS, links, before, samples, strict=True
            )
        ]


def _result(
    variant: NodeVariant, minutes: float, commands: int, samples: Sequence[float]
) -> MemoryResult:
    return MemoryResult(variant.name, minutes, commands, samples[0], samples[-1], max(samples))
