"""Section 3: the robot, three sets for each method, along the diagonal and in the workspace.

Tables 9 and 10, and what the paper leaves out: the errors in the whole workspace.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray, pose_distance
from annik_core.target_paths import diagonal_path
from annik_training.fitting.fit import Restart, best_of, examples_of, fit_restarts
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem
from annik_training.networks.network import InverseKinematicsNetwork
from benchmarks.jobs.fit_job import random_joint_positions
from benchmarks.paper.example_sets import paper_robot, robot_set
from benchmarks.systems.library import RobotSystem

WORKSPACE_POSES = 5000
_WORKSPACE_SEED = 30_000


@dataclass(frozen=True)
class RobotSetJob:
    """One set of examples, fitted from several starts.

    Attributes:
        method: which method chose the examples.
        name: which set.
        options: how to fit.
    """

    method: str
    name: str
    options: FitOptions


@dataclass(frozen=True, eq=False)
class StartOutcome:
    """One start. Position errors in mm, orientation errors in degrees.

    Attributes:
        restart: its errors on the examples.
        path_position: ``(15,)`` along the paper's path.
        path_orientation: ``(15,)``.
        workspace_position: ``(5000,)`` at random poses of the workspace, sorted.
        workspace_orientation: ``(5000,)`` likewise.
    """

    restart: Restart
    path_position: FloatArray
    path_orientation: FloatArray
    workspace_position: FloatArray
    workspace_orientation: FloatArray


@dataclass(frozen=True, eq=False)
class RobotSetOutcome:
    """All starts of a set; the winner has the least error on the held-out examples."""

    starts: tuple[StartOutcome, ...]
    winner: int


def run_robot_set(job: RobotSetJob) -> RobotSetOutcome:
    """Fit all starts to a set and measure each."""
    system = RobotSystem(paper_robot())
    examples = examples_of(system, robot_set(job.method, job.name), job.options)
    restarts = fit_restarts(examples, job.options)
    path = diagonal_path()
    unseen = random_joint_positions(system, WORKSPACE_POSES, _WORKSPACE_SEED)
    workspace = system.robot.forward_kinematics.poses(unseen)
    starts = []
    for restart in restarts:
        inverse = InverseKinematicsNetwork(system.encoding, restart.network)
        on_path = _errors(system, inverse, path)
        in_workspace = _errors(system, inverse, workspace)
        starts.append(
            StartOutcome(
                restart,
                on_path[0],
                on_path[1],
                np.sort(in_workspace[0]),
                np.sort(in_workspace[1]),
            )
        )
    return RobotSetOutcome(tuple(starts), best_of(restarts).number)


def _errors(
    system: InverseKinematicsSystem, network: InverseKinematicsNetwork, poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position errors [mm] and orientation errors [deg] ``(n,)`` at poses ``(n, 7)``."""
    achieved = system.robot.forward_kinematics.poses(network.joint_positions(poses))
    distances, angles = pose_distance(poses, achieved)
    return 1e3 * distances, np.degrees(angles)
