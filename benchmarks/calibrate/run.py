"""Every method on every split, each result safe on the disk as soon as it is there."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.append_log import AppendLog
from annik_core.robots.errors import InvalidRobotDefinition
from annik_training.calibration.errors import CalibrationError
from benchmarks.calibrate.geometry import FloatArray
from benchmarks.calibrate.methods import METHODS, Prediction
from benchmarks.calibrate.problems import SOCKET_DISTANCE, MeasuredSet, Rows, cached_sets
from benchmarks.jobs.job_runner import run_jobs


@dataclass(frozen=True)
class Settings:
    """What is compared.

    Attributes:
        methods: names, in the order of the columns.
        sizes: numbers of rows to calibrate with; of sockets, all but those of a placement.
        splits: how often for each size.
        sets: names; empty for all.
    """

    methods: tuple[str, ...] = tuple(METHODS)
    sizes: tuple[int, ...] = (20, 50, 100, 200, 400)
    splits: int = 5
    sets: tuple[str, ...] = ()


@dataclass(frozen=True)
class Job:
    """One calibration."""

    folder: str
    name: str
    method: str
    size: int  #: rows to calibrate with
    split: int  #: number of the split, or of the placement that is left out


@dataclass(frozen=True)
class Outcome:
    """How far held-out rows are from the calibrated robot; of sockets, balls from their mean.

    Attributes:
        mean: distance [m].
        worst: greatest distance [m].
        angle: mean angle [rad], or of sockets the error of their distance [m]; None if not known.
        within: part of the positions, and of the orientations, within the stated bound.
        seconds: time of the calibration.
        parts: of the model, in words.
        refused: why there is no calibration; the numbers are NaN then.
    """

    mean: float | None = None
    worst: float | None = None
    angle: float | None = None
    within: tuple[float | None, float | None] = (None, None)
    seconds: float = 0.0
    parts: str = ""
    refused: str = ""


def jobs_of(folder: Path, sets: Sequence[MeasuredSet], settings: Settings) -> list[Job]:
    """All calibrations."""
    jobs = []
    for one in sets:
        if one.has_sockets:
            splits = [(len(one.rows), placement) for placement in range(one.placements)]
        else:
            splits = [
                (size, number)
                for size in one.sizes(settings.sizes)
                for number in range(settings.splits)
            ]
        jobs += [
            Job(str(folder), one.name, method, *split)
            for split in splits
            for method in settings.methods
            if not one.has_sockets or METHODS[method].knows_sockets
        ]
    return jobs


def run_all(
    jobs: Sequence[Job], log: Path, workers: int, on_outcome: Callable[[Job, Outcome], None]
) -> dict[Job, Outcome]:
    """Run the jobs that are not in the log yet.

    Raises:
        NotWritable, InUse, DamagedRecord: if the log can't be used.
        WorkerEnded: if a worker process was killed.
    """
    with AppendLog(log) as records:
        found = {}
        for record in records.records:
            outcome = {**record["outcome"], "within": tuple(record["outcome"]["within"])}
            found[Job(**record["job"])] = Outcome(**outcome)
        for job, result in run_jobs(
            outcome_of, [job for job in jobs if job not in found], workers
        ):
            records.append({"job": asdict(job), "outcome": asdict(result)})
            found[job] = result
            on_outcome(job, result)
    return {job: found[job] for job in jobs}


def outcome_of(job: Job) -> Outcome:
    """Calibrate, and judge by the other rows."""
    one = cached_sets(Path(job.folder))[job.name]
    rows, held_out = one.split(job.size, job.split)
    begin = time.perf_counter()
    try:
        prediction = METHODS[job.method].predict(one, rows, held_out.joint_positions)
    except (CalibrationError, InvalidRobotDefinition) as error:
        return Outcome(seconds=time.perf_counter() - begin, refused=str(error))
    seconds = time.perf_counter() - begin
    if held_out.sockets is not None:
        numbers = _of_sockets(prediction, held_out)
    else:
        numbers = _of_poses(prediction, held_out)
    return Outcome(**numbers, seconds=seconds, parts=prediction.parts)


def _of_poses(prediction: Prediction, held_out: Rows) -> dict[str, Any]:
    assert held_out.positions is not None
    distances = np.linalg.norm(prediction.positions - held_out.positions, axis=1)
    angles: FloatArray | None = None
    if held_out.rotations is not None:
        between = prediction.rotations @ np.swapaxes(held_out.rotations, 1, 2)
        angles = Rotation.from_matrix(between).magnitude()
    within: list[float | None] = [None, None]
    if prediction.bounds is not None:
        for index, errors in enumerate((distances, angles)):
            if errors is not None:
                within[index] = float((errors <= prediction.bounds[:, index]).mean())
    return {
        "mean": float(distances.mean()),
        "worst": float(distances.max()),
        "angle": None if angles is None else float(angles.mean()),
        "within": tuple(within),
    }


def _of_sockets(prediction: Prediction, held_out: Rows) -> dict[str, Any]:
    assert held_out.sockets is not None
    balls = [
        prediction.positions[held_out.sockets == socket] for socket in np.unique(held_out.sockets)
    ]
    means = [ball.mean(axis=0) for ball in balls]
    away = np.concatenate(
        [np.linalg.norm(ball - mean, axis=1) for ball, mean in zip(balls, means, strict=True)]
    )
    within = None
    if prediction.bounds is not None:
        bounds = prediction.bounds[np.argsort(held_out.sockets, kind="stable"), 0]
        within = float((away <= bounds).mean())
    return {
        "mean": float(away.mean()),
        "worst": float(away.max()),
        "angle": abs(float(np.linalg.norm(means[0] - means[1])) - SOCKET_DISTANCE),
        "within": (within, None),
    }
