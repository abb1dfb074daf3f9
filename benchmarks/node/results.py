"""What was measured, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.conditions import Conditions
from benchmarks.node.settings import NodeBenchSettings
from benchmarks.plain_data import built


@dataclass(frozen=True)
class Summary:
    """Of several times, in the unit that they were given in; NaN if there are none.

    Attributes:
        p50: the median.
        p99: 99 % are at most this.
        max: the largest.
    """

    p50: float
    p99: float
    max: float

    @classmethod
    def of(cls, values: ArrayLike) -> Summary:
        """The summary of some values ``(n,)``."""
        array = np.asarray(values, dtype=np.float64)
        if array.size == 0:
            return cls(float("nan"), float("nan"), float("nan"))
        return cls(*np.percentile(array, [50.0, 99.0, 100.0]).tolist())


@dataclass(frozen=True)
class RoundTripResult:
    """Round trips of one node.

    Attributes:
        node: its name.
        executor: the one of rclpy that it uses.
        in_a_row: targets in a row before those of the next node.
        time: of its round trips [us].
        cpu: its processor time per message [us].
        asked: number of targets.
        unanswered: of those without a command in time.
    """

    node: str
    executor: str
    in_a_row: int
    time: Summary
    cpu: float
    asked: int
    unanswered: int


@dataclass(frozen=True)
class StreamResult:
    """Targets at a rate for one node.

    Attributes:
        node: its name.
        queue_depth: number of targets that may wait.
        rate: wanted [1/s].
        reached_rate: at which the targets were really published [1/s].
        sent: number of targets.
        answered: number of those whose command arrived.
        age: of these, when their commands were made [ms].
        cpu: processor time of the node by time [%], of one core.
    """

    node: str
    queue_depth: int
    rate: float
    reached_rate: float
    sent: int
    answered: int
    age: Summary
    cpu: float


@dataclass(frozen=True)
class MemoryResult:
    """Resident set of one node over time.

    Attributes:
        node: its name.
        minutes: time between the first and the last sample [min].
        answers: number of commands in this time.
        begin: after the warm-up [MB], 1 MB being 1e6 bytes.
        end: at the end [MB].
        largest: in between [MB].
    """

    node: str
    minutes: float
    answers: int
    begin: float
    end: float
    largest: float


@dataclass(frozen=True)
class StartResult:
    """Starts of one node.

    Attributes:
        node: its name.
        starts: how many.
        fastest: the shortest time to the first command [s].
        median: of all of them [s].
        worst: the longest [s].
    """

    node: str
    starts: int
    fastest: float
    median: float
    worst: float


@dataclass(frozen=True)
class NodeBenchResults:
    """All of it.

    Attributes:
        settings: how much was measured.
        conditions: on what.
        round_trips: one per node, executor and number in a row.
        streams: one per rate, queue and node.
        memory: one per node.
        starts: one per node.
        skipped: what could not be measured, and why.
    """

    settings: NodeBenchSettings
    conditions: Conditions
    round_trips: Sequence[RoundTripResult]
    streams: Sequence[StreamResult]
    memory: Sequence[MemoryResult]
    starts: Sequence[StartResult]
    skipped: Sequence[str] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> NodeBenchResults:
        """The reverse of :meth:`to_dict`."""
        results: NodeBenchResults = built(cls, data)
        return results
