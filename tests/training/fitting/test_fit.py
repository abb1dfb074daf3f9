"""The fit of a robot's inverse kinematics to a dataset. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from annik_core.dataset import Dataset
from annik_core.pose import pose_difference
from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.robot import Robot
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.fitting.fit import TooFewExamples, dataset_examples, fit
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem

QUICK = FitOptions(restarts=2, max_evaluations=8)


@pytest.fixture(scope="module")
def dataset(gantry: Robot) -> Dataset:
    return generate_dataset(gantry, "thirty_phase", 3, seed=0)


def test_same_seed_same_network(dataset: Dataset) -> None:
    """Bit for bit on one machine; another seed gives another network."""
    poses = dataset.poses[:20]
    first = fit(dataset, QUICK).network.joint_positions(poses)
    again = fit(dataset, QUICK).network.joint_positions(poses)
    other = fit(dataset, replace(QUICK, seed=1)).network
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other.joint_positions(poses))


def test_the_winner_is_the_network_that_is_returned(gantry: Robot, dataset: Dataset) -> None:
    """Its errors are those of the winning restart, on the held-out examples and on the others."""
    told = []
    fitted = fit(dataset, replace(QUICK, restarts=4, max_evaluations=4), told.append)
    assert tuple(told) == fitted.restarts
    assert fitted.winner == int(np.argmin([restart.held_out_error for restart in told]))
    assert len(fitted.held_out) == 15

    def scaled_error(rows: np.ndarray) -> float:
        workspace = gantry.workspace
        poses = [
            workspace.resolve(pose, workspace.reference(example)).pose
            for pose, example in zip(
                dataset.poses[rows], dataset.joint_positions[rows], strict=True
            )
        ]
        off = fitted.network.joint_positions(np.array(poses)) - dataset.joint_positions[rows]
        half_width = 0.5 * (gantry.joint_box.upper - gantry.joint_box.lower)
        return float(np.mean((off / half_width) ** 2))

    winner = fitted.restarts[fitted.winner]
    others = np.setdiff1d(np.arange(len(dataset)), fitted.held_out)
    assert scaled_error(fitted.held_out) == pytest.approx(winner.held_out_error, rel=1e-6)
    assert scaled_error(others) == pytest.approx(winner.training_error, rel=1e-6)


def test_held_out_examples_have_no_part_in_a_restart(dataset: Dataset) -> None:
    """Other held-out examples, the same network bit for bit."""
    options = replace(QUICK, restarts=1)
    fitted = fit(dataset, options)
    joint_positions, poses = dataset.joint_positions.copy(), dataset.poses.copy()
    joint_positions[fitted.held_out] = dataset.robot.joint_box.centre
    poses[fitted.held_out] = dataset.robot.forward_kinematics.poses(
        joint_positions[fitted.held_out]
    )
    again = fit(replace(dataset, joint_positions=joint_positions, poses=poses), options)
    assert np.array_equal(again.held_out, fitted.held_out)
    assert np.array_equal(
        fitted.network.joint_positions(dataset.poses[:20]),
        again.network.joint_positions(dataset.poses[:20]),
    )
    assert again.restarts[0].held_out_error != fitted.restarts[0].held_out_error


def test_without_held_out_examples_the_training_error_chooses(dataset: Dataset) -> None:
    fitted = fit(dataset, FitOptions(restarts=3, max_evaluations=4, held_out_fraction=0.0))
    assert fitted.held_out.tolist() == []
    assert [restart.held_out_error for restart in fitted.restarts] == [None] * 3
    errors = [restart.training_error for restart in fitted.restarts]
    assert fitted.winner == int(np.argmin(errors))


def test_it_learns_the_poses_of_the_dataset(gantry: Robot) -> None:
    """Not those of the robot's model: here they were measured, with the base 10 mm off."""
    computed = random_dataset(gantry, gantry.joint_box, 9, seed=0)
    shift = np.array([0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    measured = replace(computed, poses=computed.poses + shift)
    options = FitOptions(restarts=1, held_out_fraction=0.0, linear_path=True)
    network = fit(measured, options).network
    unseen = random_dataset(gantry, gantry.joint_box, 100, seed=1)
    answer = network.joint_positions(unseen.poses + shift)
    assert answer == pytest.approx(unseen.joint_positions, abs=1e-9)


def test_its_features_are_position_and_roll_pitch_yaw(gantry: Robot) -> None:
    """By SciPy, off the gimbal edge; on it, the example's own."""
    dataset = generate_dataset(gantry, "thirty_phase", 6, seed=0)
    examples = dataset_examples(InverseKinematicsSystem(gantry), dataset, FitOptions())
    assert np.array_equal(examples.targets, dataset.joint_positions)
    kinematics = gantry.forward_kinematics
    assert isinstance(kinematics, GantryKinematics)
    task = kinematics.task_coordinates(dataset.joint_positions)
    edge = task[:, 4] > np.radians(89.99)
    assert 20 < edge.sum() < 60
    poses = dataset.poses[~edge]
    angles = Rotation.from_quat(poses[:, 3:]).as_euler("xyz")
    assert examples.inputs[~edge] == pytest.approx(np.hstack([poses[:, :3], angles]), abs=1e-9)
    assert examples.inputs[edge] == pytest.approx(task[edge], abs=1e-6)


@pytest.mark.parametrize(
    "options",
    [
        FitOptions(restarts=2, max_evaluations=40),
        FitOptions(restarts=1, max_evaluations=3, linear_path=True, sobolev_weight=1.0),
    ],
    ids=["plain", "linear_path+sobolev"],
)
def test_it_learns_the_robot_from_102_examples(
    gantry: Robot, dataset: Dataset, options: FitOptions
) -> None:
    """Loosely: a hundredth of a millimetre is usual, a millimetre is a broken fit."""
    network = fit(dataset, options).network
    unseen = random_dataset(gantry, gantry.joint_box, 500, seed=123)
    answer = network.joint_positions(unseen.poses)
    position, rotation = pose_difference(unseen.poses, gantry.forward_kinematics.poses(answer))
    assert np.linalg.norm(position, axis=1).max() < 1e-3
    assert np.linalg.norm(rotation, axis=1).max() < np.radians(0.2)


def test_too_few_examples(gantry: Robot) -> None:
    few = random_dataset(gantry, gantry.joint_box, 7, seed=0)
    with pytest.raises(TooFewExamples) as caught:
        fit(few, QUICK)
    assert (caught.value.examples, caught.value.minimum) == (7, 8)
    assert fit(few, replace(QUICK, held_out_fraction=0.0)).held_out.size == 0
