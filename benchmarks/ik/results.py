"""What the benchmark found, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from annik_core.installation import share_directory
from annik_core.model.artifact import Model
from benchmarks.conditions import Conditions
from benchmarks.ik.measure import TargetResult
from benchmarks.ik.measure_alone import AloneResult
from benchmarks.ik.measure_paths import PathResult
from benchmarks.ik.peers.peer import Kind, Peer
from benchmarks.plain_data import built


@dataclass(frozen=True)
class BenchSettings:
    """How much is measured.

    Attributes:
        targets: random poses.
        paths: straight lines.
        points: on each line.
        rounds: how often each solver is timed on each target.
        recall_poses: of a whole robot, whose solutions are all sought; the first of the targets.
        restarts: of a reference on each of these.
        seed: of targets and lines; apart from those of training, so that none is an example.
    """

    targets: int = 2000
    paths: int = 200
    points: int = 100
    rounds: int = 3
    recall_poses: int = 100
    restarts: int = 2000
    seed: int = 2026


#: Every part, roughly: to see that it works.
QUICK = BenchSettings(targets=50, paths=5, points=20, rounds=1, recall_poses=5, restarts=200)


@dataclass(frozen=True)
class SolverEntry:
    """A solver that took part: what it is and how it was set."""

    name: str
    version: str
    kind: Kind
    settings: str

    @classmethod
    def of(cls, solver: Peer) -> SolverEntry:
        """The entry of a solver."""
        return cls(solver.name, solver.version, solver.kind, solver.settings)


@dataclass(frozen=True)
class ModelEntry:
    """The model file that annik took part with.

    Attributes:
        file: its name.
        sha256: of the file.
        examples: it was trained on.
        design: of experiments that they come from.
        hidden_units: of the network.
        packaged: whether it comes with annik.
    """

    file: str
    sha256: str
    examples: int
    design: str
    hidden_units: tuple[int, ...]
    packaged: bool

    @classmethod
    def of(cls, artifact: Model) -> ModelEntry:
        """The entry of a model file."""
        metadata = artifact.metadata
        return cls(
            artifact.path.name,
            artifact.sha256,
            metadata.examples,
            metadata.design,
            tuple(metadata.hidden_units),
            artifact.path.parent == share_directory() / "models",
        )


@dataclass(frozen=True)
class BenchResults:
    """Everything that the benchmark found.

    Attributes:
        robot: its name.
        model: the model file.
        settings: how much was measured.
        solvers: those that took part, in the order of the tables.
        skipped: name of each solver that did not, and the reason.
        targets: by the solvers' names.
        alone: likewise.
        paths: likewise; empty if the robot has no such paths.
        lines_tried: to find the paths.
        throughput: poses per second by name and size of batch.
        threads: poses per second of the largest batch by annik's threads.
        calibrated: on targets of a calibrated robot, by the solvers' names.
        conditions: what it ran on.
    """

    robot: str
    model: ModelEntry
    settings: BenchSettings
    solvers: Sequence[SolverEntry]
    skipped: Sequence[tuple[str, str]]
    targets: Mapping[str, TargetResult]
    alone: Mapping[str, AloneResult]
    paths: Mapping[str, PathResult]
    lines_tried: int
    throughput: Mapping[str, Mapping[int, float]]
    threads: Mapping[int, float]
    calibrated: Mapping[str, TargetResult]
    conditions: Conditions

    @property
    def all_solvers(self) -> list[SolverEntry]:
        """Those of :attr:`calibrated` too."""
        known = {solver.name: solver for solver in self.solvers}
        ours = SolverEntry("", "", "ours", "")
        return [known.get(name, replace(ours, name=name)) for name in {**known, **self.calibrated}]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON, in which some names say more."""
        data = asdict(self)
        rates = data.pop("throughput")
        return {
            **data,
            "skipped": [{"name": name, "reason": reason} for name, reason in self.skipped],
            "targets": {name: found.to_dict() for name, found in self.targets.items()},
            "alone": {name: found.to_dict() for name, found in self.alone.items()},
            "calibrated": {name: found.to_dict() for name, found in self.calibrated.items()},
            "poses_per_second": rates,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> BenchResults:
        """The reverse of :meth:`to_dict`."""
        skipped = [(entry["name"], entry["reason"]) for entry in data["skipped"]]
        content = {**data, "skipped": (), "throughput": data["poses_per_second"]}
        results: BenchResults = built(cls, content)
        return replace(results, skipped=skipped)
