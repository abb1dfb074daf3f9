"""Whole robots: annik and the solvers of others anywhere within the joint limits.

The solvers, their settings and what counts as right are those of :mod:`benchmarks.ik`; the joint
box is as wide as the limits, or, where they are wider, the full turn in their middle.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.arm import arm_from_definition
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from benchmarks.conditions import Conditions, load
from benchmarks.ik.annik import whole_robot
from benchmarks.ik.calibrated import calibrated_urdf
from benchmarks.ik.measure import TargetResult, measure_targets
from benchmarks.ik.measure_paths import PathResult, measure_paths
from benchmarks.ik.peers import ikpy
from benchmarks.ik.peers.library import available_peers
from benchmarks.ik.peers.peer import Peer, SolvesAll
from benchmarks.ik.peers.problem import IkProblem
from benchmarks.ik.query import no_garbage_collection
from benchmarks.ik.results import BenchSettings, SolverEntry
from benchmarks.ik.run import WARM_UP, OnProgress
from benchmarks.ik.straight_paths import straight_paths
from benchmarks.ik.targets import random_targets
from benchmarks.ik.verification import ORIENTATION_TOLERANCE, POSITION_TOLERANCE, Verifier
from benchmarks.robots.folder import ArmFile
from benchmarks.robots.oracle import Oracle

ARMS = ("ur5e", "panda", "xarm6", "puma560")
CALIBRATED = "ur5e, calibrated"
#: Calls for all solutions of a pose; the median counts.
_CALLS = 3
#: The ends of a path differ by at most this in each joint [rad or m].
FAR = 0.6
#: IKPy would take longer than all others together.
_LEFT_OUT = (ikpy.NAME,)


@dataclass(frozen=True)
class EveryResult:
    """How one solver did in listing all solutions. CPU times in microseconds.

    Attributes:
        solutions: mean number of those that are right and within the limits.
        recall: mean share of the known ones; None where a pose has infinitely many.
        complete: share of the poses with all of them; None likewise.
    """

    solutions: float
    recall: float | None
    complete: float | None
    median_us: float
    p99_us: float


@dataclass(frozen=True)
class WholeArm:
    """An arm; the results are by the solvers' names.

    Attributes:
        poses: of which all solutions were sought.
    """

    name: str
    targets: Mapping[str, TargetResult]
    every: Mapping[str, EveryResult]
    paths: Mapping[str, PathResult]
    poses: int


@dataclass(frozen=True)
class WholeResults:
    """Everything."""

    settings: BenchSettings
    arms: Sequence[WholeArm]
    solvers: Sequence[SolverEntry]
    conditions: Conditions


@dataclass(frozen=True, eq=False)
class _ThenNewton:
    """A closed form of the arm as described, each solution refined on the calibrated arm."""

    closed: SolvesAll
    oracle: Oracle

    @property
    def name(self) -> str:
        """See :class:`benchmarks.ik.peers.peer.SolvesAll`."""
        return f"{self.closed.name} as described, then Newton"

    def solutions(self, pose: FloatArray) -> FloatArray:
        """See :meth:`benchmarks.ik.peers.peer.SolvesAll.solutions`."""
        found = np.array(self.closed.solutions(pose)).reshape(-1, len(self.oracle.lower))
        return self.oracle.refined(found, pose)


def measure_whole_robots(settings: BenchSettings, on_progress: OnProgress) -> WholeResults:
    """Measure all solvers on all arms; see :func:`benchmarks.ik.run.run_bench`."""
    load_before, arms, solvers = load(), [], dict[str, SolverEntry]()
    for name in (*ARMS, CALIBRATED):
        # The calibration is the same for any amount.
        rng = np.random.default_rng(settings.seed)
        described = load_robot(name.partition(",")[0])
        urdf = str(described.definition["urdf"])
        if name == CALIBRATED:
            urdf = calibrated_urdf(described, rng)
        arm = ArmFile(name, urdf, described.base_frame, described.end_effector_frame)
        # Of the URDF alone: the packaged definition has a joint box.
        robot = arm_from_definition(
            {
                "urdf": urdf,
                "base_frame": arm.base_frame,
                "end_effector_frame": arm.end_effector_frame,
            },
            name,
        )
        problem, oracle = _problem(robot, urdf), Oracle.of(arm)
        peers = [peer for peer in available_peers(problem)[0] if peer.name not in _LEFT_OUT]
        taking_part = [whole_robot(robot), *peers]
        solvers.update({solver.name: SolverEntry.of(solver) for solver in taking_part})
        listing: list[SolvesAll] = [one for one in taking_part if isinstance(one, SolvesAll)]
        if name == CALIBRATED:
            closed, _ = available_peers(replace(problem, urdf=str(described.definition["urdf"])))
            listing += [_ThenNewton(one, oracle) for one in closed if isinstance(one, SolvesAll)]
        show = partial(_shown, on_progress, name)
        arms.append(
            _measured(name, robot, oracle, taking_part, listing, problem, settings, rng, show)
        )
    return WholeResults(
        settings,
        arms,
        list(solvers.values()),
        Conditions.now(("numpy", "scipy", "onnxruntime"), load_before),
    )


def _shown(on_progress: OnProgress, name: str, part: str, total: int, done: int) -> None:
    on_progress(f"{name}: {part}", done, total)


def _problem(robot: Robot, urdf: str) -> IkProblem:
    frames = robot.base_frame, robot.end_effector_frame
    limits, box = robot.joint_limits, robot.joint_box
    bounds = limits.lower, limits.upper, box.lower, box.upper
    return IkProblem(urdf, *frames, robot.joint_names, *bounds)


def _measured(
    name: str,
    robot: Robot,
    oracle: Oracle,
    solvers: Sequence[Peer],
    listing: Sequence[SolvesAll],
    problem: IkProblem,
    settings: BenchSettings,
    rng: np.random.Generator,
    show: Callable[[str, int, int], None],
) -> WholeArm:
    verifier = Verifier(problem)
    targets = random_targets(robot, settings.targets, rng)
    on_targets = measure_targets(
        solvers,
        targets,
        random_targets(robot, WARM_UP, rng),
        verifier,
        settings.rounds,
        partial(show, "targets", settings.rounds * settings.targets),
    )
    poses = targets[: settings.recall_poses]
    every = _measured_every(
        listing, poses, oracle, settings.restarts, rng, partial(show, "all", len(poses))
    )
    paths, _ = straight_paths(robot, settings.paths, settings.points, rng, far=FAR)
    on_paths = measure_paths(
        solvers, paths, verifier, partial(show, "paths", len(paths)), follow=True
    )
    return WholeArm(name, on_targets, every, on_paths, len(poses))


def _measured_every(
    listing: Sequence[SolvesAll],
    poses: FloatArray,
    oracle: Oracle,
    restarts: int,
    rng: np.random.Generator,
    on_pose: Callable[[int], None],
) -> dict[str, EveryResult]:
    finite = len(oracle.lower) <= 6
    times = np.empty((len(listing), _CALLS, len(poses)))
    found = np.empty((len(listing), len(poses)))
    known = np.empty(len(poses))
    with no_garbage_collection():
        for row, pose in enumerate(poses):
            lists = []
            for number, solver in enumerate(listing):
                for call in range(_CALLS):
                    begin = time.thread_time_ns()
                    solutions = solver.solutions(pose)
                    times[number, call, row] = time.thread_time_ns() - begin
                lists.append(_right(oracle, np.array(solutions), pose))
                found[number, row] = len(lists[-1])
            if finite:
                restarted = oracle.refined(oracle.sample(restarts, rng), pose)
                known[row] = len(oracle.distinct(np.vstack([*lists, restarted])))
            on_pose(row + 1)
    microseconds = 1e-3 * np.median(times, axis=1)
    results = {}
    for number, solver in enumerate(listing):
        shares = found[number] / np.maximum(known, 1.0)
        median, p99 = np.percentile(microseconds[number], [50, 99]).tolist()
        results[solver.name] = EveryResult(
            float(found[number].mean()),
            float(shares.mean()) if finite else None,
            float((shares == 1.0).mean()) if finite else None,
            median,
            p99,
        )
    return results


def _right(oracle: Oracle, solutions: FloatArray, pose: FloatArray) -> FloatArray:
    """The different solutions ``(n, dof)`` that are right and within the limits."""
    solutions = solutions.reshape(-1, len(oracle.lower))
    distances, angles = oracle.errors(solutions, pose[np.newaxis])
    right = (distances <= POSITION_TOLERANCE) & (angles <= ORIENTATION_TOLERANCE)
    # Polished, as those near a singularity would count twice otherwise.
    return oracle.distinct(oracle.refined(solutions[right], pose))
