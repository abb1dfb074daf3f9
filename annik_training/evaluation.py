"""How good a network is: the forward kinematics of its answers against the poses asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.dataset import Dataset
from annik_core.ik_solver import SolverMode
from annik_core.pose import FloatArray, pose_distance
from annik_core.refinement_options import Refined, RefinementOptions
from annik_training.refined_evaluation import RefinedEvaluation, evaluate_refined, refine_all

PERCENTILES = {"p50": 50.0, "p95": 95.0, "p99": 99.0, "max": 100.0}


@dataclass(frozen=True)
class ErrorSummary:
    """Distribution of an error, in the unit of what was summarised."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def of(cls, errors: FloatArray) -> ErrorSummary:
        """Summary of errors ``(n,)``."""
        percentiles = {
            name: float(np.percentile(errors, percent)) for name, percent in PERCENTILES.items()
        }
        return cls(rms=float(np.sqrt(np.mean(errors**2))), **percentiles)


@dataclass(frozen=True)
class Evaluation:
    """Errors of a network on a dataset it has not seen.

    Attributes:
        examples: how many poses.
        seed: the seed that they were drawn from.
        position_error: [m].
        orientation_error: [rad].
        outside_joint_limits: fraction of answers that a solver would refuse.
        refined: what refinement makes of the answers; None for a robot whose node does not refine.
    """

    examples: int
    seed: int
    position_error: ErrorSummary
    orientation_error: ErrorSummary
    outside_joint_limits: float
    refined: RefinedEvaluation | None = None

    def as_plain_data(self) -> dict[str, Any]:
        """For a model's metadata; the units are in the names."""
        data = {
            "examples": self.examples,
            "seed": self.seed,
            "position_error_m": vars(self.position_error),
            "orientation_error_rad": vars(self.orientation_error),
            "outside_joint_limits": self.outside_joint_limits,
        }
        return data if self.refined is None else {**data, "refined": self.refined.as_plain_data()}


@dataclass(frozen=True, eq=False)
class Measured:
    """What a network answers to poses that it has not seen, one row per pose.

    Attributes:
        dataset: the poses.
        answers: ``(n, dof)`` [rad or m].
        distances: ``(n,)`` from where the answers lead to the poses [m].
        angles: ``(n,)`` [rad].
        refined: the answers polished; None for a robot whose node does not refine.
    """

    dataset: Dataset
    answers: FloatArray
    distances: FloatArray
    angles: FloatArray
    refined: list[Refined] | None


def evaluate(joint_positions: Callable[[FloatArray], FloatArray], dataset: Dataset) -> Evaluation:
    """Measure and sum up; see :func:`measure` and :func:`summarise`."""
    return summarise(measure(joint_positions, dataset))


def measure(joint_positions: Callable[[FloatArray], FloatArray], dataset: Dataset) -> Measured:
    """Ask a function from poses ``(n, 7)`` to joint positions ``(n, dof)``.

    Args:
        joint_positions: the network, as trained or as exported.
        dataset: poses, usually random ones; each is resolved as the solver does without a
            previous command.
    """
    robot = dataset.robot
    poses = np.array([robot.workspace.resolve(pose, None).pose for pose in dataset.poses])
    answer = joint_positions(poses)
    achieved = robot.forward_kinematics.poses(answer)
    distances, angles = pose_distance(dataset.poses, achieved)
    refined = (
        refine_all(answer, dataset, RefinementOptions())
        if SolverMode.AUTO.refines(robot)
        else None
    )
    return Measured(dataset, answer, distances, angles, refined)


def summarise(measured: Measured) -> Evaluation:
    """The errors in percentiles."""
    dataset, answers = measured.dataset, measured.answers
    limits = dataset.robot.joint_limits
    outside = ~((answers >= limits.lower) & (answers <= limits.upper)).all(axis=1)
    return Evaluation(
        examples=len(dataset),
        seed=dataset.seed,
        position_error=ErrorSummary.of(measured.distances),
        orientation_error=ErrorSummary.of(measured.angles),
        outside_joint_limits=float(outside.mean()),
        refined=(
            None if measured.refined is None else evaluate_refined(measured.refined, dataset)
        ),
    )
