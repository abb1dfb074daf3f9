"""The whole benchmark, part by part."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np

from annik_ros.parameters import ExecutorChoice
from benchmarks.conditions import Conditions, load
from benchmarks.node.client import Client
from benchmarks.node.memory import measure_memory
from benchmarks.node.nodes import NULL, NodeVariant
from benchmarks.node.results import NodeBenchResults
from benchmarks.node.round_trip import measure_round_trips
from benchmarks.node.settings import NodeBenchSettings
from benchmarks.node.start_up import measure_starts
from benchmarks.node.streams import measure_streams
from benchmarks.node.target_stream import TargetStreams

#: Called with the name of each part when it begins.
OnProgress = Callable[[str], None]

_SEED = 20260321
_LIBRARIES = ("rclpy", "numpy", "onnxruntime", "pin")
_EVENTS, _SINGLE = ExecutorChoice.EVENTS.value, ExecutorChoice.SINGLE_THREADED.value


def run_node_bench(
    settings: NodeBenchSettings, logs: Path, on_progress: OnProgress
) -> NodeBenchResults:
    """Measure everything, in the ROS domain that the environment names.

    Args:
        settings: how much.
        logs: existing folder for what the nodes print.
        on_progress: see :data:`OnProgress`.

    Raises:
        AnnikError: if a node can't be started, or no command of it arrives.
    """
    load_before = load()
    timed = [
        NodeVariant(NULL, _SINGLE),
        NodeVariant(NULL, _EVENTS),
        NodeVariant("ik_node", _SINGLE, "gantry"),
        NodeVariant("ik_node", _EVENTS, "gantry"),
    ]
    started = [NodeVariant(NULL, _EVENTS), NodeVariant("ik_node", _EVENTS, "gantry")]
    if settings.arm:
        timed.append(NodeVariant("ik_node", _EVENTS, settings.arm))
        started.append(NodeVariant("ik_node", _EVENTS, settings.arm))
    rng = np.random.default_rng(_SEED)
    with closing(Client()) as client:
        on_progress("round trips")
        round_trips = [
            result
            for in_a_row in settings.in_a_row
            for result in measure_round_trips(client, timed, settings.rounds, in_a_row, logs, rng)
        ]
        on_progress("starts")
        starts = measure_starts(client, started, settings.starts, logs, rng)
        with closing(TargetStreams()) as publisher:
            on_progress("streams")
            streams = measure_streams(
                client, publisher, settings.streams, settings.stream_seconds, logs, rng
            )
            on_progress("memory")
            memory = measure_memory(
                client, publisher, settings.warm_up_seconds, settings.memory_minutes, logs, rng
            )
        return NodeBenchResults(
            settings=settings,
            conditions=Conditions.now(_LIBRARIES, load_before, client.middleware),
            round_trips=round_trips,
            streams=streams,
            memory=memory,
            starts=starts,
        )
