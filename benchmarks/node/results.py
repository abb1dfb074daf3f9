"""What was measured, as plain data."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.conditions import processor
from benchmarks.node.settings import NodeBenchSettings

_LIBRARIES = ("rclpy", "numpy", "onnxruntime", "pin")


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
        executor: what calls it back.
        in_a_row: how often it was asked before it was the next one's turn.
        time: of its round trips [us].
        cpu: its processor time for a message [us].
        asked: how often it was asked.
        unanswered: how often it did not answer in time.
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
    """One node, asked at a rate.

    Attributes:
        node: its name.
        queue_depth: how many targets may wait.
        rate: that was asked for [1/s].
        reached_rate: at which the targets were really published [1/s].
        sent: how many targets.
        answered: how many of them have a command that arrived.
        age: of the answered targets when their commands were made [ms].
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
        minutes: how long it was watched [min].
        answers: how many commands came meanwhile.
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
class Conditions:
    """What it ran on.

    Attributes:
        processor: its name.
        cores: as the system counts them.
        governor: of the first core's frequency; empty if nobody says.
        python: its version.
        middleware: ROS 2's.
        libraries: versions by name.
        load_before: the system's load of the minute before.
        load_after: of the minute before the end.
    """

    processor: str
    cores: int
    governor: str
    python: str
    middleware: str
    libraries: dict[str, str]
    load_before: float
    load_after: float


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

    def as_plain_data(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def conditions(load_before: float, middleware: str) -> Conditions:
    """What this runs on; the load of now is the one after."""
    libraries = {}
    for name in _LIBRARIES:
        try:
            libraries[name] = version(name)
        except PackageNotFoundError:
            continue
    return Conditions(
        processor=processor(),
        cores=os.cpu_count() or 1,
        governor=_governor(),
        python=platform.python_version(),
        middleware=middleware,
        libraries=libraries,
        load_before=load_before,
        load_after=os.getloadavg()[0],
    )


def _governor() -> str:
    path = "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"
    try:
        with open(path, encoding="ascii") as file:
            return file.read().strip()
    except OSError:
        return ""
