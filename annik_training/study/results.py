"""The file in which a study keeps what it has measured: one line per job, safe as soon as written.

A line is JSON: ``job`` is what was measured and with which version of annik, ``outcome`` or
``failure`` what came out, ``check`` a checksum of these. Lines are only appended, and none is
changed. A job may have several; the last one counts.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

from annik_core.errors import DamagedStudyResults, StudyInUse, StudyNotWritable
from annik_core.version import VERSION
from annik_training.evaluation import ErrorSummary
from annik_training.jobs.fit_job import FitJob, FitOutcome
from annik_training.study.job import JobFailure
from annik_training.systems.inverse_kinematics_system import InverseKinematicsSystem
from annik_training.systems.library import load_system

FILE_NAME = "results.jsonl"


class StudyResults:
    """The results in a folder, open for this process alone.

    Use it as a context manager.

    Attributes:
        path: the file.
        was_cut_off: whether the last line was incomplete, and was taken off.
    """

    def __init__(self, folder: Path) -> None:
        """Open the results of a folder, which is made if it is not there.

        Raises:
            StudyInUse: if another process has them open.
            DamagedStudyResults: if a line is not as it was written.
            StudyNotWritable: if the file can't be opened.
        """
        self.path = folder / FILE_NAME
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = self.path.open("a+b", buffering=0)
        except OSError as error:
            raise StudyNotWritable(self.path, error.strerror or str(error)) from error
        try:
            self._lock()
            self._by_job, self._size = self._read()
            self.was_cut_off = self._cut_off()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> StudyResults:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file, which unlocks it."""
        self._file.close()

    def outcome(self, job: FitJob) -> FitOutcome | JobFailure | None:
        """What came out of a job, or None if it was not run."""
        found = self._by_job.get(_key(job))
        if found is None:
            return None
        number, line = found
        try:
            if "failure" in line:
                return JobFailure(str(line["failure"]))
            outcome = line["outcome"]
            return FitOutcome(**{**outcome, "error": ErrorSummary(**outcome["error"])})
        except (KeyError, TypeError) as error:
            raise DamagedStudyResults(
                self.path, number, "its outcome is not in the form of this annik"
            ) from error

    def record(self, job: FitJob, outcome: FitOutcome | JobFailure) -> None:
        """Append an outcome; it is on the disk when this returns.

        Raises:
            StudyNotWritable: if it can't be written. The file is then as it was before.
        """
        line: dict[str, Any] = {"job": _content(job)}
        if isinstance(outcome, JobFailure):
            line["failure"] = outcome.reason
        else:
            line["outcome"] = asdict(outcome)
        data = json.dumps({**line, "check": _digest(line)}, allow_nan=False).encode() + b"\n"
        self._append(data)
        self._by_job[_key(job)] = (-1, line)

    def read_again(self) -> None:
        """Take the outcomes from the file, as if it were opened now."""
        self._by_job, self._size = self._read()

    def _lock(self) -> None:
        # On the file itself: the lock goes when the process ends, however it ends.
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StudyInUse(self.path) from error
        except OSError as error:
            raise StudyNotWritable(self.path, error.strerror or str(error)) from error

    def _read(self) -> tuple[dict[str, tuple[int, dict[str, Any]]], int]:
        """Lines by their job, with their numbers, and where the last whole one ends."""
        self._file.seek(0)
        data = self._file.read()
        # What follows the last end of line was being written when the process or machine died.
        whole = data[: data.rfind(b"\n") + 1]
        by_job = {}
        for number, text in enumerate(whole.split(b"\n")[:-1], start=1):
            line = self._line(number, text)
            by_job[_digest(line["job"])] = (number, line)
        return by_job, len(whole)

    def _line(self, number: int, text: bytes) -> dict[str, Any]:
        try:
            line = json.loads(text)
            check = line.pop("check")
            if check == _digest(line) and {"outcome", "failure"} & set(line) and "job" in line:
                return dict(line)
        # JSON's and Unicode's faults are ValueErrors; the others are another form.
        except (ValueError, AttributeError, KeyError, TypeError, RecursionError):
            pass
        raise DamagedStudyResults(self.path, number, "it is damaged, or not of annik")

    def _cut_off(self) -> bool:
        try:
            if os.fstat(self._file.fileno()).st_size == self._size:
                return False
            os.ftruncate(self._file.fileno(), self._size)
        except OSError as error:
            raise StudyNotWritable(self.path, error.strerror or str(error)) from error
        return True

    def _append(self, data: bytes) -> None:
        descriptor = self._file.fileno()
        try:
            written = 0
            while written < len(data):
                # A disk that fills up takes a part first.
                written += os.write(descriptor, data[written:])
            os.fsync(descriptor)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(descriptor, self._size)
            raise StudyNotWritable(self.path, error.strerror or str(error)) from error
        self._size += len(data)


def _content(job: FitJob) -> dict[str, Any]:
    """All that the outcome of a job depends on."""
    system = load_system(job.system)
    # A definition may change under the same path.
    robot = system.robot if isinstance(system, InverseKinematicsSystem) else None
    return {
        **job.as_plain_data(),
        "annik_version": VERSION,
        "robot_sha256": robot.definition_hash if robot else None,
    }


def _key(job: FitJob) -> str:
    return _digest(_content(job))


def _digest(content: Mapping[str, Any]) -> str:
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
