"""What something was measured on, for the line under its table. Loads none of the libraries."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_LIBRARIES = ("numpy", "scipy", "torch", "onnxruntime")
#: Variables that limit the threads of linear algebra.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Conditions:
    """Machine, load and versions.

    Attributes:
        processor: its name.
        cores: as the operating system counts them.
        python: its version.
        libraries: versions by name, of those that are installed.
        load_before: average load of the minute before the measurements; None if not noted.
        load_after: of the minute before their end.
        governor: frequency governor of the first core; empty if unknown.
        middleware: of ROS 2; empty without ROS.
        threads: the variables that limit the threads of linear algebra, where they are set.
    """

    processor: str
    cores: int
    python: str
    libraries: Mapping[str, str]
    load_before: float | None
    load_after: float
    governor: str = ""
    middleware: str = ""
    threads: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def now(
        cls,
        libraries: Sequence[str] = _LIBRARIES,
        load_before: float | None = None,
        middleware: str = "",
    ) -> Conditions:
        """The conditions at the end of the measurements."""
        return cls(
            processor=_processor(),
            cores=os.cpu_count() or 1,
            python=platform.python_version(),
            libraries=_versions(libraries),
            load_before=load_before,
            load_after=load(),
            governor=_first_line(Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")),
            middleware=middleware,
            threads={name: os.environ[name] for name in _THREADS if name in os.environ},
        )

    def __str__(self) -> str:
        """One sentence."""
        before = "" if self.load_before is None else f" {self.load_before:.1f} before and"
        parts = [
            self.processor,
            f"{self.cores} cores",
            f"governor {self.governor}" if self.governor else "",
            f"load{before} {self.load_after:.1f}{' after' if before else ''}",
            f"Python {self.python}",
            self.middleware,
            *(f"{name} {number}" for name, number in self.libraries.items()),
            *(f"{name}={value}" for name, value in self.threads.items()),
        ]
        return ", ".join(part for part in parts if part) + "."


def machine() -> str:
    """Processor, cores, load and versions at this moment, in one sentence."""
    return str(Conditions.now())


def load() -> float:
    """Average load of the last minute."""
    return os.getloadavg()[0]


def _versions(libraries: Sequence[str]) -> dict[str, str]:
    found = {}
    for name in libraries:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _first_line(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii").strip()
    except OSError:
        return ""
