"""The whole benchmark: targets, paths, throughput, with all solvers that are there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from annik_core.model.artifact import Model
from benchmarks.conditions import Conditions, load
from benchmarks.ik import throughput
from benchmarks.ik.annik import AS_DESCRIBED, NO_KERNEL, our_solvers, refined
from benchmarks.ik.calibrated import (
    calibrated,
    calibrated_verifier,
    geometric_problem,
    without_kernel,
)
from benchmarks.ik.measure import TargetResult, measure_targets
from benchmarks.ik.measure_alone import measure_alone
from benchmarks.ik.measure_paths import measure_paths
from benchmarks.ik.peers.library import available_peers
from benchmarks.ik.results import BenchResults, BenchSettings, ModelEntry, SolverEntry
from benchmarks.ik.robot_problem import robot_problem
from benchmarks.ik.straight_paths import straight_paths
from benchmarks.ik.targets import random_targets
from benchmarks.ik.verification import Verifier

#: Targets before the first that counts.
WARM_UP = 50
_LIBRARIES = ("numpy", "scipy", "onnxruntime", "pin")

#: Called with the part, how much of it is done, and of how much.
OnProgress = Callable[[str, int, int], None]


def run_bench(artifact: Model, settings: BenchSettings, on_progress: OnProgress) -> BenchResults:
    """Measure all solvers on one robot.

    Args:
        artifact: the model file that annik takes part with; its robot is the one.
        settings: how much to measure.
        on_progress: see :data:`OnProgress`.

    Raises:
        NotAnArm: see :func:`benchmarks.ik.robot_problem.robot_problem`.
    """
    robot = artifact.robot
    problem = robot_problem(robot)
    verifier = Verifier(problem)
    peers, skipped = available_peers(problem)
    solvers = [*our_solvers(artifact), refined(without_kernel(artifact), NO_KERNEL), *peers]
    # A stream for each part: the targets do not depend on the number of paths.
    for_targets, for_warm_up, for_paths, for_batches, for_calibrated = (
        np.random.default_rng(entropy)
        for entropy in np.random.SeedSequence(settings.seed).spawn(5)
    )
    paths, tried = straight_paths(
        robot,
        settings.paths,
        settings.points,
        for_paths,
        lambda done: on_progress("finding paths", done, settings.paths),
    )
    targets = random_targets(robot, settings.targets, for_targets)
    load_before = load()
    on_targets = measure_targets(
        solvers,
        targets,
        random_targets(robot, WARM_UP, for_warm_up),
        verifier,
        settings.rounds,
        lambda done: on_progress("targets", done, settings.rounds * settings.targets),
    )
    alone = measure_alone(
        solvers,
        targets,
        robot.dof,
        lambda done: on_progress("targets, each solver alone", done, settings.targets),
    )
    on_paths = (
        measure_paths(
            solvers, paths, verifier, lambda done: on_progress("paths", done, len(paths))
        )
        if paths
        else {}
    )
    turns = throughput.turns(len(solvers), len(throughput.SIZES))
    batch = random_targets(robot, max(throughput.SIZES), for_batches)
    rates = throughput.measure_throughput(
        solvers,
        batch,
        throughput.SIZES,
        throughput.SECONDS,
        lambda done: on_progress("throughput", done, turns),
    )
    return BenchResults(
        robot=robot.name,
        model=ModelEntry.of(artifact),
        settings=settings,
        solvers=[SolverEntry.of(solver) for solver in solvers],
        skipped=skipped,
        targets=on_targets,
        alone=alone,
        paths=on_paths,
        lines_tried=tried,
        throughput=rates,
        threads=throughput.measure_threads(artifact, batch),
        calibrated=_on_calibrated(artifact, settings, for_calibrated, on_progress),
        conditions=Conditions.now(_LIBRARIES, load_before),
    )


def _on_calibrated(
    artifact: Model, settings: BenchSettings, rng: np.random.Generator, on_progress: OnProgress
) -> dict[str, TargetResult]:
    """The targets of a calibrated robot; the others have what a URDF can say of it."""
    model = calibrated(artifact, rng)
    peers, _ = available_peers(geometric_problem(model.robot))
    slow = refined(without_kernel(model), NO_KERNEL)
    return measure_targets(
        [refined(artifact, AS_DESCRIBED), refined(model), slow, *peers],
        random_targets(model.robot, settings.targets, rng),
        random_targets(model.robot, WARM_UP, rng),
        calibrated_verifier(model.robot),
        settings.rounds,
        lambda done: on_progress("calibrated robot", done, settings.rounds * settings.targets),
    )
