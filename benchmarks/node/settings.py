"""How much is measured."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StreamPlan:
    """A stream of targets.

    Attributes:
        rate: [1/s].
        queue_depth: number of targets that may wait at the node.
    """

    rate: float
    queue_depth: int


@dataclass(frozen=True)
class NodeBenchSettings:
    """How much is measured; the defaults take about half an hour.

    Attributes:
        rounds: round trips of each node, for each of ``in_a_row``.
        in_a_row: targets in a row before those of the next node.
        stream_seconds: duration of each stream [s].
        memory_minutes: time over which the memory is sampled, after the warm-up [min].
        starts: of each node.
        warm_up_seconds: of the memory [s].
        arm: the packaged arm that is measured beside the gantry; empty: none.
        streams: what is published.
    """

    rounds: int = 10_000
    in_a_row: tuple[int, ...] = (50, 1)
    stream_seconds: float = 60.0
    memory_minutes: float = 10.0
    starts: int = 30
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
