"""How much is measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StreamPlan:
    """A stream of targets.

    Attributes:
        rate: [1/s].
        queue_depth: how many targets may wait at the node.
    """

    rate: float
    queue_depth: int


@dataclass(frozen=True)
class NodeBenchSettings:
    """How much is measured; the defaults take about half an hour.

    Attributes:
        rounds: how often each node is asked for its round trip, either way.
        in_a_row: how often one node is asked before the next has its turn.
        stream_seconds: how long each stream lasts [s].
        memory_minutes: how long the memory is watched, after the warm-up [min].
        starts: how often each node is started.
        warm_up_seconds: how long both nodes are asked before their memory counts [s].
        arm: the packaged arm that is measured beside the gantry; empty: none.
        streams: what is published.
    """

    rounds: int = 10_000
    in_a_row: tuple[int, ...] = (50, 1)
    stream_seconds: float = 60.0
    memory_minutes: float = 10.0
    starts: int = 10
    warm_up_seconds: float = 30.0
    arm: str = "ur5e"
    streams: tuple[StreamPlan, ...] = (
        StreamPlan(100.0, 1),
        StreamPlan(1000.0, 1),
        StreamPlan(1000.0, 100),
        StreamPlan(5000.0, 1),
    )


#: Every part, roughly: to see that it works.
QUICK = NodeBenchSettings(
    rounds=50,
    stream_seconds=0.5,
    memory_minutes=0.01,
    starts=1,
    warm_up_seconds=0.2,
    arm="",
    streams=(StreamPlan(1000.0, 1),),
)
