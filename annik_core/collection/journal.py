"""The journal of a collection: an append-only log of the measured examples.

The first record identifies plan and robot by their hashes, and has the number of samples and the
order of the examples. Every other record is a measured example.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from annik_core.append_log import AppendLog
from annik_core.collection.measurement import noise_of_averages
from annik_core.collection.settings import CollectionSettings
from annik_core.dataset import MEASURED, Dataset
from annik_core.errors import AnnikError, NotWritable
from annik_core.installation import annik_version
from annik_core.pose import FloatArray, checked_pose
from annik_core.robots.definition import is_numeric

FORMAT_VERSION = 1


class JournalMismatch(AnnikError):
    """A journal belongs to another plan or robot, or to another number of samples."""

    def __init__(self, path: Path, what: str, journal: object, given: object) -> None:
        self.path = path
        self.what = what
        self.journal = journal
        self.given = given
        super().__init__(
            f"journal {path} was begun with {what} {journal}, not {given}: give the same to "
            "continue it, or another dataset to begin a new one"
        )


@dataclass(frozen=True, eq=False)
class MeasuredExample:
    """The measurement of one row of the plan.

    Attributes:
        pose: ``(7,)`` mean pose: x, y, z [m], unit quaternion x, y, z, w, in the base frame.
        square_sums: sums of squares of the samples' distances [m^2] and angles [rad^2] from it.
        joint_positions: ``(dof,)`` measured there [rad or m]; the plan has the commanded ones.
    """

    row: int
    pose: FloatArray
    square_sums: tuple[float, float]
    joint_positions: FloatArray


def journal_path(dataset: Path) -> Path:
    """The path of the journal of a dataset: beside it."""
    return dataset.with_name(f"{dataset.stem}.journal.jsonl")


def open_journal(dataset: Path, plan: Dataset, samples: int) -> "CollectionJournal":
    """Open the journal beside a dataset that is measured in part, or not yet.

    Raises:
        NotWritable: if the dataset exists without a journal, so that it is another one.
        AnnikError: as :class:`CollectionJournal`.
    """
    path = journal_path(dataset)
    if dataset.exists() and not path.exists():
        raise NotWritable(
            dataset,
            f"it exists without its journal {path.name}",
            "give another dataset, or move this one",
        )
    return CollectionJournal(path, plan, samples)


class CollectionJournal:
    """The journal of a plan, locked for this process alone; a context manager, or to be closed.

    ``order``: the rows of the plan in the order to visit them; None before :meth:`begin`.
    """

    def __init__(self, path: Path, plan: Dataset, samples: int) -> None:
        """Open the journal of a plan; create it if it is missing.

        Raises:
            InUse: if another process has it open.
            DamagedRecord: if a line was altered.
            JournalMismatch: if it belongs to another plan, robot, or number of samples.
            NotWritable: if the file can't be opened.
        """
        self.path = path
        self.plan = plan
        self.order: tuple[int, ...] | None = None
        self.examples: dict[int, MeasuredExample] = {}
        self._samples = samples
        self._log = AppendLog(path, has_header=True)
        try:
            self._read()
        except BaseException:
            self._log.close()
            raise

    def __enter__(self) -> "CollectionJournal":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close and unlock the file."""
        self._log.close()

    @property
    def remaining(self) -> tuple[int, ...]:
        """The rows that are not measured yet, in the order to visit them."""
        return tuple(row for row in self.order or () if row not in self.examples)

    @property
    def is_complete(self) -> bool:
        """Whether every row is measured."""
        return len(self.examples) == len(self.plan)

    def begin(self, order: Sequence[int], settings: CollectionSettings) -> None:
        """Write the header, or raise NotWritable: the order and what identifies the collection."""
        self._log.append(
            {
                **self._identity,
                "order": list(order),
                # For readers only: settings may change when a collection is continued.
                "settings": _plain_settings(settings),
                "annik_version": annik_version(),
            }
        )
        self.order = tuple(order)

    def record(self, example: MeasuredExample) -> None:
        """Append an example; it is on the disk when this returns.

        Raises:
            NotWritable: if it can't be written. The journal is then as it was before.
        """
        self._log.append(
            {
                "row": example.row,
                "pose": example.pose.tolist(),
                "square_sums": list(example.square_sums),
                "joint_positions": example.joint_positions.tolist(),
            }
        )
        self.examples[example.row] = example

    def reload(self) -> None:
        """Read the examples again: an interruption may follow a record before its entry here.

        Raises:
            DamagedRecord: if a line was altered.
        """
        self._log.reload()
        self._read()

    def dataset(self) -> Dataset:
        """The measured examples, with their joint positions, in the order of the plan."""
        plan = self.plan
        measured = [self.examples[row] for row in sorted(self.examples)]
        kept = np.isin(np.arange(len(plan)), list(self.examples))
        return dataclasses.replace(
            plan.rows(kept),
            poses=np.array([example.pose for example in measured]).reshape(-1, 7),
            source=MEASURED,
            measurement_noise=noise_of_averages(
                [(self._samples, example.square_sums) for example in measured]
            ),
        )

    @property
    def _identity(self) -> dict[str, Any]:
        return {
            "format_version": FORMAT_VERSION,
            "plan_sha256": self.plan.content_hash,
            "robot_sha256": self.plan.robot.definition_hash,
            "samples": self._samples,
        }

    def _read(self) -> None:
        records = self._log.records
        self.examples.clear()
        if not records:
            return
        self._read_first(records[0])
        for number, record in enumerate(records[1:], start=2):
            try:
                example = self._example(record)
            except (AnnikError, KeyError, TypeError, ValueError) as error:
                problem = f"it is not an example of this plan ({error})"
                raise self._log.damaged(number, problem) from error
            self.examples[example.row] = example

    def _read_first(self, header: Mapping[str, Any]) -> None:
        if not {"order", *self._identity} <= set(header):
            raise self._log.damaged(1, "it is not the header of a journal")
        names = {
            "format_version": "format version",
            "robot_sha256": "a robot of SHA-256",
            "plan_sha256": "a plan of SHA-256",
            "samples": "samples",
        }
        for key, name in names.items():
            if header[key] != self._identity[key]:
                raise JournalMismatch(self.path, name, header[key], self._identity[key])
        order = header["order"]
        if not isinstance(order, list) or sorted(order) != list(range(len(self.plan))):
            raise self._log.damaged(1, "its order is not one of the plan's rows")
        self.order = tuple(order)

    def _example(self, line: Mapping[str, Any]) -> MeasuredExample:
        row = line["row"]
        if type(row) is not int or not 0 <= row < len(self.plan):
            raise ValueError(f"row {row!r}")
        if row in self.examples:
            raise ValueError(f"row {row} a second time")
        numbers = [line["pose"], line["square_sums"], line["joint_positions"]]
        if not is_numeric(numbers):
            raise ValueError("not numbers")
        joint_positions = np.array(line["joint_positions"], dtype=np.float64)
        if joint_positions.shape != (self.plan.robot.dof,):
            raise ValueError(f"{joint_positions.size} joint positions")
        position, orientation = line["square_sums"]
        if not (position >= 0 and orientation >= 0):
            raise ValueError("a negative sum of squares")
        return MeasuredExample(
            row, checked_pose(line["pose"]), (float(position), float(orientation)), joint_positions
        )


def _plain_settings(settings: CollectionSettings) -> dict[str, Any]:
    # JSON has no infinity.
    return {
        name: [str(number) for number in value] if isinstance(value, tuple) else str(value)
        for name, value in dataclasses.asdict(settings).items()
    }
