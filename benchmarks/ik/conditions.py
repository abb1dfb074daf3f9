"""What a benchmark ran on: processor, load, versions. Without torch, which it does not need."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.conditions import processor
from benchmarks.ik.peers.peer import installed_version

_LIBRARIES = ("numpy", "scipy", "onnxruntime", "pin")
#: What says how many threads the libraries of linear algebra use.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Conditions:
    """What a benchmark ran on.

    Attributes:
        processor: its name.
        cores: as the system counts them.
        python: its version.
        libraries: versions by name.
        threads: the variables that limit the threads of linear algebra, where they are set.
        load_before: the system's load of the minute before the measurements.
        load_after: of the minute before their end; the benchmark itself adds 1.
    """

    processor: str
    cores: int
    python: str
    libraries: dict[str, str]
    threads: dict[str, str]
    load_before: float
    load_after: float

    def as_plain_data(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def load() -> float:
    """Average load of the last minute."""
    return os.getloadavg()[0]


def conditions(load_before: float) -> Conditions:
    """What this runs on; the load of now is the one after."""
    return Conditions(
        processor=processor(),
        cores=os.cpu_count() or 1,
        python=platform.python_version(),
        libraries={name: installed_version(name) for name in _LIBRARIES},
        threads={name: os.environ[name] for name in _THREADS if name in os.environ},
        load_before=load_before,
        load_after=load(),
    )
