"""Errors of a model at random poses: of the network alone, and refined as a node does."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from annik_core.dataset import Dataset
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.arm_kinematics import readable_kinematics
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.robot import ForwardKinematics, Robot
from annik_core.robots.screw_chain import ScrewChain
from annik_core.safety import AcceptanceLimits
from annik_core.solver.ik_solver import IkSolver, refinement_of
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import RefinementOptions, RefinementResults
from annik_core.solver.whole_robot import WholeRobot
from annik_training.defaults import DEFAULT_EVALUATION_POSES
from annik_training.designs.registry import random_dataset
from annik_training.joint_box import mobility

if TYPE_CHECKING:
    from annik_core.model.artifact import Model

#: Joint positions closer than this are the same solution [rad or m].
SAME_SOLUTION = 1e-3


@dataclass(frozen=True)
class ErrorSummary:
    """Distribution of an error, in the unit of the errors."""

    rms: float
    p50: float
    p95: float
    p99: float
    max: float

    @classmethod
    def of(cls, errors: FloatArray) -> "ErrorSummary":
        """Summary of errors ``(n,)``."""
        percentiles = np.percentile(errors, [50, 95, 99, 100]).tolist()
        return cls(float(np.sqrt(np.mean(errors**2))), *percentiles)


@dataclass(frozen=True)
class RefinedEvaluation:
    """Errors after refinement of the network's joint positions."""

    success: float  #: fraction that converged; all of these are inside the joint box
    #: Fraction that ended at the joint positions that the pose was made from. The other successes
    #: found a second solution inside the box.
    same_solution: float
    mean_steps: float
    p99_steps: float
    max_steps: int
    position_residual: float  #: greatest distance of a success from its target [m]
    orientation_residual: float  #: greatest angle [rad]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for a model's metadata; the units are in the names."""
        return _with_units(self)


def _with_units(evaluation: "RefinedEvaluation | WholeRobotEvaluation") -> dict[str, Any]:
    data = dict(vars(evaluation))
    data["position_residual_m"] = data.pop("position_residual")
    data["orientation_residual_rad"] = data.pop("orientation_residual")
    return data


@dataclass(frozen=True)
class WholeRobotEvaluation:
    """Poses from anywhere within the joint limits, answered as a node answers a whole robot."""

    answered: float  #: fraction with a solution
    #: Fraction whose solution is within the joint limits and reaches the pose, by forward
    #: kinematics in NumPy.
    right: float
    position_residual: float  #: greatest distance of a solution from its pose [m]
    orientation_residual: float  #: greatest angle [rad]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for a model's metadata; the units are in the names."""
        return _with_units(self)


@dataclass(frozen=True)
class Evaluation:
    """Errors of a model at poses that it was not trained on."""

    examples: int
    seed: int
    position_error: ErrorSummary  #: of the network alone [m]
    orientation_error: ErrorSummary  #: of the network alone [rad]
    #: Fraction of the network's joint positions outside the joint limits.
    outside_joint_limits: float
    #: Fraction of them that a node accepts by default, without refinement.
    accepted: float
    #: Joints that can move together while the end effector rests.
    redundant_joints: list[str]
    #: Errors after refinement; None for a robot whose solutions are not refined in a joint box.
    refined: RefinedEvaluation | None = None
    whole_robot: WholeRobotEvaluation | None = None  #: of a robot that is served as a whole

    def to_dict(self) -> dict[str, Any]:
        """Plain data for a model's metadata; the units are in the names."""
        data = dict(vars(self))
        data["position_error_m"] = vars(data.pop("position_error"))
        data["orientation_error_rad"] = vars(data.pop("orientation_error"))
        for key in ("refined", "whole_robot"):
            part = data.pop(key)
            if part is not None:
                data[key] = part.to_dict()
        return data


@dataclass(frozen=True, eq=False)
class NetworkErrors:
    """Errors of a network at the poses of a dataset, one row per pose."""

    dataset: Dataset  #: the poses, with joint positions that reach them
    joint_positions: FloatArray  #: ``(n, dof)`` of the network [rad or m]
    distances: FloatArray  #: ``(n,)`` of the poses there from the poses of the dataset [m]
    angles: FloatArray  #: ``(n,)`` [rad]
    #: The joint positions refined; None for a robot whose solutions are not refined in a box.
    refined: RefinementResults | None
    #: Of a whole robot, the solution of each pose ``(n, dof)``; NaN where there is none.
    solutions: FloatArray | None = None

    @property
    def unsolved(self) -> NDArray[np.bool_] | None:
        """Poses ``(n,)`` that a node does not solve; None if it takes the network's output."""
        if self.solutions is not None:
            unsolved: NDArray[np.bool_] = np.isnan(self.solutions[:, 0])
            return unsolved
        return None if self.refined is None else ~self.refined.converged

    def summary(self) -> Evaluation:
        """Percentiles of the errors."""
        limits, acceptance = self.dataset.robot.joint_limits, AcceptanceLimits()
        within = (self.joint_positions >= limits.lower) & (self.joint_positions <= limits.upper)
        inside = within.all(axis=1)
        near = self.distances <= acceptance.max_position_residual
        near &= self.angles <= acceptance.max_orientation_residual
        return Evaluation(
            examples=len(self.dataset),
            seed=self.dataset.seed,
            position_error=ErrorSummary.of(self.distances),
            orientation_error=ErrorSummary.of(self.angles),
            outside_joint_limits=float((~inside).mean()),
            accepted=float((inside & near).mean()),
            redundant_joints=mobility(self.dataset.robot).redundant,
            refined=(
                None if self.refined is None else _refined_evaluation(self.refined, self.dataset)
            ),
            whole_robot=(
                None if self.solutions is None else _whole_evaluation(self.solutions, self.dataset)
            ),
        )


def evaluate(
    model: "Model", *, poses: int = DEFAULT_EVALUATION_POSES, seed: int = 0
) -> Evaluation:
    """Errors of a model at random poses of its robot's joint box, drawn by the seed."""
    dataset = evaluation_dataset(model.robot, poses, seed)
    return network_errors(model.joint_positions, dataset).summary()


@dataclass(frozen=True, eq=False)
class SearchTimes:
    """How long the searches of a whole robot took, pose by pose, on this machine now."""

    first: FloatArray  #: ``(n,)`` until the preferred solution [s]
    every: FloatArray  #: ``(n,)`` until all solutions [s]
    counts: NDArray[np.int64]  #: ``(n,)`` solutions of each pose


def search_times(model: "Model", poses: FloatArray) -> SearchTimes:
    """Time the solver of a whole robot on poses ``(n, 7)``."""
    solver, first, every, counts = IkSolver(model), [], [], []
    for pose in poses:
        begin = time.perf_counter()
        solver.solve(pose)
        first.append(time.perf_counter() - begin)
    for pose in poses:
        begin = time.perf_counter()
        counts.append(len(solver.solutions(pose)))
        every.append(time.perf_counter() - begin)
    return SearchTimes(np.array(first), np.array(every), np.array(counts))


def evaluation_dataset(robot: Robot, poses: int, seed: int) -> Dataset:
    """Random poses of a robot's joint box, drawn independently of all that is trained on."""
    entropy = np.random.SeedSequence([seed, poses]).generate_state(1)[0]
    return random_dataset(robot, robot.joint_box, poses, int(entropy))


def network_errors(
    joint_positions: Callable[[FloatArray], FloatArray], dataset: Dataset
) -> NetworkErrors:
    """Errors of a network, as trained or as exported: poses ``(n, 7)`` to ``(n, dof)``.

    Each pose of the dataset is resolved as by the solver without a previous command.
    """
    robot = dataset.robot
    poses = np.array([robot.workspace.resolve(pose, None).pose for pose in dataset.poses])
    found = joint_positions(poses)
    distances, angles = pose_distance(dataset.poses, robot.forward_kinematics.poses(found))
    refined, solutions, mode = None, None, SolverMode.AUTO.of(robot)
    if mode is SolverMode.REFINED:
        refined = refinement_of(robot).refine_batch(found, dataset.poses)
    elif mode is SolverMode.WHOLE_ROBOT:
        whole, solutions = WholeRobot(robot), np.full_like(found, np.nan)
        for row, (pose, start) in enumerate(zip(dataset.poses, found, strict=True)):
            candidate = whole.preferred(pose, start[np.newaxis])
            if candidate.converged:
                solutions[row] = candidate.joint_positions
    return NetworkErrors(dataset, found, distances, angles, refined, solutions)


def _whole_evaluation(solutions: FloatArray, dataset: Dataset) -> WholeRobotEvaluation:
    """Summary of solutions ``(n, dof)``, their poses computed without the compiled kernel."""
    robot = dataset.robot
    answered = ~np.isnan(solutions[:, 0])
    found = solutions[answered]
    if not len(found):
        return WholeRobotEvaluation(0.0, 0.0, 0.0, 0.0)
    achieved = _readable_kinematics(robot).poses(found)
    distances, angles = pose_distance(dataset.poses[answered], achieved)
    limits, tolerance = robot.joint_limits, 2.0 * RefinementOptions().tolerance
    right = ((found >= limits.lower) & (found <= limits.upper)).all(axis=1)
    right &= (distances <= tolerance) & (angles <= tolerance)
    return WholeRobotEvaluation(
        answered=float(answered.mean()),
        right=float(right.sum() / len(answered)),
        position_residual=float(distances.max()),
        orientation_residual=float(angles.max()),
    )


def _readable_kinematics(robot: Robot) -> ForwardKinematics:
    """Forward kinematics of an arm in NumPy."""
    corrections = robot.definition.get("corrections")
    if corrections is not None:
        corrections = ArmCorrections.from_dict(corrections, robot.dof, robot.name)
    chain = ScrewChain.from_urdf(robot.definition["urdf"])
    turning, centre = robot.turning, robot.joint_box.centre
    return readable_kinematics(robot.joint_names, chain, corrections, turning, centre)


def _refined_evaluation(refined: RefinementResults, dataset: Dataset) -> RefinedEvaluation:
    """Summary of refinements; the residuals are measured again, from poses computed anew."""
    converged, found = refined.converged, refined.joint_positions
    off = np.abs(dataset.robot.difference(found, dataset.joint_positions)).max(axis=1)
    if not converged.any():
        return RefinedEvaluation(0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0)
    steps = refined.newton_steps[converged]
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
