"""One arm: answers, recall, times and straight paths."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.arm import arm_from_definition
from annik_core.robots.task import Task
from annik_core.solver.whole_robot import WholeRobot
from benchmarks.ik.straight_paths import straight_line
from benchmarks.ik.verification import ORIENTATION_TOLERANCE, POSITION_TOLERANCE
from benchmarks.robots.folder import ArmFile
from benchmarks.robots.oracle import Oracle

#: The ends of a path differ by at most this in each joint [rad or m].
_FAR = 0.6
#: A step is large if it is more than this many times what the path needs.
LARGE = 1.5
#: Besides, for rounding [rad or m].
_ROUNDING = 1e-4
#: A pose of so many joints has a finite number of solutions.
FINITE = 6
_WARM_UP = 20

_Value = TypeVar("_Value")


@dataclass(frozen=True)
class RobotsSettings:
    """How much is measured.

    Attributes:
        poses: for the share that is answered, and the times.
        recall_poses: the first of them, for the recall.
        restarts: of Newton's method on each.
        paths: straight lines.
        points: on each line.
        seed: of all of it.
    """

    poses: int = 2000
    recall_poses: int = 2000
    restarts: int = 2000
    paths: int = 200
    points: int = 100
    seed: int = 2026


@dataclass(frozen=True)
class PathsResult:
    """Paths, each up to where it ends.

    Attributes:
        paths: how many.
        asked: points that the arm was asked for.
        answered: of these.
        whole: paths that were followed to their end.
        branch_ends: paths that end so.
        not_converged: paths that end so.
        too_early: of the paths that end, where small steps lead to the next point all the same.
        wrong: points whose answer misses the target or the limits.
        large_steps: more than :data:`LARGE` times what the path needs.
        largest_step: of a joint [rad or m].
        largest_ratio: of a step to what the path needs.
    """

    paths: int
    asked: int
    answered: int
    whole: int
    branch_ends: int
    not_converged: int
    too_early: int
    wrong: int
    large_steps: int
    largest_step: float
    largest_ratio: float


@dataclass(frozen=True)
class ArmResult:
    """An arm. Shares are between 0 and 1, times CPU times in microseconds: median and p99.

    Attributes:
        name: of the file.
        joints: R for each that turns, P for each that slides, from the base.
        answered: share of the poses.
        right: share of the answers that reach the pose within the limits.
        recall: mean share of the solutions that the search finds, of those that it or the
            restarts find; None for an arm with more joints than a pose needs.
        complete: share of the poses with all solutions; None likewise.
        solutions: mean number that the search finds; of redundant joints a sample.
        first: time of the preferred solution.
        every: time of all solutions.
        paths: straight paths.
    """

    name: str
    joints: str
    answered: float
    right: float
    recall: float | None
    complete: float | None
    solutions: float
    first: tuple[float, float]
    every: tuple[float, float]
    paths: PathsResult


def measured_arm(arm: ArmFile, settings: RobotsSettings) -> ArmResult:
    """Measure an arm.

    Raises:
        InvalidRobotDefinition: if annik can't read it.
    """
    definition = {
        "urdf": arm.urdf,
        "base_frame": arm.base_frame,
        "end_effector_frame": arm.end_effector_frame,
    }
    solver = WholeRobot(arm_from_definition(definition, arm.name))
    solver.prepare()
    oracle = Oracle.of(arm)
    dof = solver.robot.dof
    for_poses, for_starts, for_paths = (
        np.random.default_rng(entropy)
        for entropy in np.random.SeedSequence(settings.seed).spawn(3)
    )
    poses = oracle.poses(oracle.sample(settings.poses, for_poses))
    near, no_starts = np.mean(oracle.full_range, axis=0), np.empty((0, dof))
    for pose in poses[:_WARM_UP]:
        solver.preferred(pose, no_starts)
        solver.every(pose, no_starts, near, turns=False)
    first = [_timed(partial(solver.preferred, pose, no_starts)) for pose in poses]
    every = [_timed(partial(solver.every, pose, no_starts, near, turns=False)) for pose in poses]
    answered = np.array([candidate.converged for candidate, _ in first])
    positions = np.array([candidate.joint_positions for candidate, _ in first])[answered]
    right = _right(oracle, positions, poses[answered])
    found = [
        np.array([candidate.joint_positions for candidate in candidates]).reshape(-1, dof)
        for candidates, _ in every
    ]
    recall = (
        [
            _recall(oracle, rows, pose, settings.restarts, for_starts)
            for rows, pose in zip(found, poses[: settings.recall_poses], strict=False)
        ]
        if dof <= FINITE
        else None
    )
    return ArmResult(
        arm.name,
        "".join("R" if turns else "P" for turns in oracle.turning),
        float(answered.mean()),
        float(right.mean()) if len(right) else 0.0,
        None if recall is None else float(np.mean(recall)),
        None if recall is None else float(np.mean(np.equal(recall, 1.0))),
        float(np.mean([len(rows) for rows in found])),
        _median_and_p99([spent for _, spent in first]),
        _median_and_p99([spent for _, spent in every]),
        _measured_paths(solver, oracle, settings, for_paths),
    )


def _timed(call: Callable[[], _Value]) -> tuple[_Value, float]:
    """What a call returns, and its CPU time in this thread [us]: others share the machine."""
    begin = time.thread_time_ns()
    value = call()
    return value, 1e-3 * (time.thread_time_ns() - begin)


def _median_and_p99(times: list[float]) -> tuple[float, float]:
    median, p99 = np.percentile(times, [50, 99]).tolist()
    return median, p99


def _right(
    oracle: Oracle, positions: FloatArray, poses: FloatArray, task: Task = Task.POSE
) -> FloatArray:
    """Which of joint positions ``(n, dof)`` are solutions of poses ``(n, 7)`` in the limits.

    Where the task is less than the pose, the orientation is not compared.
    """
    distances, angles = oracle.errors(positions, poses)
    exact = distances <= POSITION_TOLERANCE
    if task is Task.POSE:
        exact &= angles <= ORIENTATION_TOLERANCE
    return np.asarray(exact & oracle.within_limits(positions))


def _recall(
    oracle: Oracle, found: FloatArray, pose: FloatArray, restarts: int, rng: np.random.Generator
) -> float:
    # Polished too: solutions near a singularity would count twice otherwise.
    ours = oracle.distinct(oracle.refined(found, pose))
    others = oracle.refined(oracle.sample(restarts, rng), pose)
    known = len(oracle.distinct(np.vstack([ours, others])))
    return len(ours) / known if known else 1.0


def _measured_paths(
    solver: WholeRobot, oracle: Oracle, settings: RobotsSettings, rng: np.random.Generator
) -> PathsResult:
    dof = len(oracle.lower)
    none = np.empty((0, dof))
    ends = {"branch ends": 0, "not converged": 0}
    asked = answered = too_early = wrong = large = 0
    largest = ratio = 0.0
    for first in oracle.sample(settings.paths, rng):
        last = np.clip(first + rng.uniform(-_FAR, _FAR, dof), *oracle.full_range)
        if oracle.dimensions < FINITE:
            # These reach few of the poses between two: theirs are on a straight line of joints.
            shares = np.linspace(0.0, 1.0, settings.points)[:, np.newaxis]
            poses = oracle.poses(first + shares * (last - first))
        else:
            begin, end = oracle.poses(np.array([first, last]))
            poses = straight_line(begin, end, settings.points)
        previous = first
        for pose in poses[1:]:
            asked += 1
            candidate = solver.continued(pose, previous, lambda: none)
            if candidate.branch_end or not candidate.converged:
                ends["branch ends" if candidate.branch_end else "not converged"] += 1
                too_early += oracle.continues(previous, pose)
                break
            answered += 1
            positions = candidate.joint_positions
            wrong += not _right(oracle, positions[np.newaxis], pose[np.newaxis], candidate.task)[0]
            step = float(np.abs(positions - previous).max())
            needed = oracle.needed(previous, positions, pose)
            largest, ratio = max(largest, step), max(ratio, step / (needed + _ROUNDING))
            large += step > LARGE * needed + _ROUNDING
            previous = positions
    return PathsResult(
        settings.paths,
        asked,
        answered,
        settings.paths - sum(ends.values()),
        ends["branch ends"],
        ends["not converged"],
        too_early,
        wrong,
        large,
        largest,
        ratio,
    )
