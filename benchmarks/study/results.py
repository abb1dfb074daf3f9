"""The file in which a study keeps what it has measured: one line per job, safe as soon as written.

A line is JSON: ``job`` is what was measured and with which version of annik, ``outcome`` or
``failure`` what came out, ``check`` a checksum of these. Lines are only appended, and none is
changed. A job may have several; the last one counts.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any

from annik_core.append_log import AppendLog, digest
from annik_core.installation import annik_version
from annik_training.evaluation import ErrorSummary
from annik_training.fitting.problem import InverseKinematicsSystem
from benchmarks.jobs.fit_job import FitJob, FitOutcome
from benchmarks.study.job import JobFailure
from benchmarks.systems.library import load_system

FILE_NAME = "results.jsonl"


class StudyResults:
    """The results in a folder, open for this process alone.

    Use it as a context manager.

    Attributes:
        path: the file.
        truncated: whether an incomplete last line was removed.
    """

    def __init__(self, folder: Path) -> None:
        """Open the results of a folder, which is made if it is not there.

        Raises:
            InUse: if another process has them open.
            DamagedRecord: if a line is not as it was written.
            NotWritable: if the file can't be opened.
        """
        self.path = folder / FILE_NAME
        self._log = AppendLog(self.path)
        self.truncated = self._log.truncated
        try:
            self._by_job = self._index()
        except BaseException:
            self._log.close()
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
        self._log.close()

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
            problem = "its outcome is not in the form of this annik"
            raise self._log.damaged(number, problem) from error

    def record(self, job: FitJob, outcome: FitOutcome | JobFailure) -> None:
        """Append an outcome; it is on the disk when this returns.

        Raises:
            NotWritable: if it can't be written. The file is then as it was before.
        """
        line: dict[str, Any] = {"job": _content(job)}
        if isinstance(outcome, JobFailure):
            line["failure"] = outcome.reason
        else:
            line["outcome"] = asdict(outcome)
        self._log.append(line)
        self._by_job[_key(job)] = (len(self._log.records), line)

    def read_again(self) -> None:
        """Take the outcomes from the file, as if it were opened now."""
        self._log.reload()
        self._by_job = self._index()

    def _index(self) -> dict[str, tuple[int, dict[str, Any]]]:
        """Lines by their job, with their numbers."""
        by_job = {}
        for number, line in enumerate(self._log.records, start=1):
            if "job" not in line or not {"outcome", "failure"} & set(line):
                raise self._log.damaged(number, "it is not of a study")
            by_job[digest(line["job"])] = (number, line)
        return by_job


def _content(job: FitJob) -> dict[str, Any]:
    """All that the outcome of a job depends on."""
    system = load_system(job.system)
    # A definition may change under the same path.
    robot = system.robot if isinstance(system, InverseKinematicsSystem) else None
    return {
        **job.to_dict(),
        "annik_version": annik_version(),
        "robot_sha256": robot.definition_hash if robot else None,
    }


def _key(job: FitJob) -> str:
    return digest(_content(job))
