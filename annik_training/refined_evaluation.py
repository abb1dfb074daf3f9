"""How good a network's answers are once they are polished, as a node polishes them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray, pose_distance
from annik_core.refinement import Refinement
from annik_core.refinement_options import Refined, RefinementOptions

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


def refine_all(answers: FloatArray, dataset: Dataset, options: RefinementOptions) -> list[Refined]:
    """Polish answers ``(n, dof)`` to the poses of a dataset, one at a time."""
    robot = dataset.robot
    refinement = Refinement(robot.forward_kinematics, robot.joint_box, options)
    return [
        refinement.refined(answer, pose)
        for answer, pose in zip(answers, dataset.poses, strict=True)
    ]


def evaluate_refined(refined: list[Refined], dataset: Dataset) -> RefinedEvaluation:
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
