"""Evaluation of a model on random poses: the network alone, and refined as a node does.

How good a network is: the forward kinematics of its answers against the poses asked for.

How good a network's answers are once they are polished, as a node polishes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray, pose_distance
from annik_core.solver.ik_solver import SolverMode
from annik_core.solver.options import RefinementOptions, RefinementResult
from annik_core.solver.refinement import Refinement

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
    refined: list[RefinementResult] | None


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


#: Joint positions closer than this are the same solution [rad or m].
SAME_SOLUTION = 1e-3


@dataclass(frozen=True)
class RefinedEvaluation:
    """What refinement makes of a network's answers to poses that it has not seen.

    Attributes:
        success: fraction that converged; all of these are inside the working joint box.
        same_solution: fraction that ended at the joint positions that the pose was made from. A
            success that did not has found a second solution inside the box.
        mean_steps: steps of those that converged, on average.
        p99_steps: 99 of 100 took at most so many.
        max_steps: most steps that one took.
        position_residual: greatest distance of a success from its target [m].
        orientation_residual: greatest angle [rad].
    """

    success: float
    same_solution: float
    mean_steps: float
    p99_steps: float
    max_steps: int
    position_residual: float
    orientation_residual: float

    def as_plain_data(self) -> dict[str, Any]:
        """For a model's metadata; the units are in the names."""
        data = dict(vars(self))
        data["position_residual_m"] = data.pop("position_residual")
        data["orientation_residual_rad"] = data.pop("orientation_residual")
        return data


def refine_all(
    answers: FloatArray, dataset: Dataset, options: RefinementOptions
) -> list[RefinementResult]:
    """Polish answers ``(n, dof)`` to the poses of a dataset, one at a time."""
    robot = dataset.robot
    refinement = Refinement(robot.forward_kinematics, robot.joint_box, options)
    return [
        refinement.refine(answer, pose)
        for answer, pose in zip(answers, dataset.poses, strict=True)
    ]


def evaluate_refined(refined: list[RefinementResult], dataset: Dataset) -> RefinedEvaluation:
    """Sum up what :func:`refine_all` made of the poses of a dataset.

    The residuals are measured again, by poses computed anew.
    """
    converged = np.array([result.converged for result in refined])
    found = np.array([result.joint_positions for result in refined])
    off = np.abs(found - dataset.joint_positions).max(axis=1)
    if not converged.any():
        return RefinedEvaluation(0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0)
    steps = np.array([result.newton_steps for result in refined])[converged]
    achieved = dataset.robot.forward_kinematics.poses(found[converged])
    distances, angles = pose_distance(dataset.poses[converged], achieved)
    return RefinedEvaluation(
        success=float(converged.mean()),
        same_solution=float((converged & (off < SAME_SOLUTION)).mean()),
        mean_steps=float(steps.mean()),
        p99_steps=float(np.percentile(steps, 99)),
        max_steps=int(steps.max()),
        position_residual=float(np.max(distances)),
        orientation_residual=float(np.max(angles)),
    )
