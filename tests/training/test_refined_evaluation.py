"""Evaluation of refined joint positions, against a direct computation. ROS-free."""

from __future__ import annotations

import json

import numpy as np
import pytest

from annik_core.dataset import Dataset
from annik_core.pose import pose_distance
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.solver.refinement import Refinement
from annik_core.solver.result import RefinementOptions
from annik_training.designs.registry import random_dataset
from annik_training.evaluation import SAME_SOLUTION, NetworkErrors, network_errors


@pytest.fixture(scope="module")
def ur5e() -> Robot:
    return load_robot("ur5e")


@pytest.fixture(scope="module")
def unseen(ur5e: Robot) -> Dataset:
    return random_dataset(ur5e, ur5e.joint_box, 200, seed=5)


@pytest.fixture(scope="module")
def measured(unseen: Dataset) -> NetworkErrors:
    """Joint positions that are off by up to half a radian, and some by far."""
    rng = np.random.default_rng(0)
    off = rng.uniform(-0.5, 0.5, unseen.joint_positions.shape)
    off[:20] *= 6.0
    return network_errors(lambda _: unseen.joint_positions + off, unseen)


def test_the_numbers_are_those_of_a_direct_computation(
    ur5e: Robot, unseen: Dataset, measured: NetworkErrors
) -> None:
    search = Refinement(ur5e.forward_kinematics, ur5e.joint_box, RefinementOptions())
    steps, distances, angles, same = [], [], [], 0
    for answer, pose, joints in zip(
        measured.joint_positions, unseen.poses, unseen.joint_positions, strict=True
    ):
        found = search.refine(answer, pose)
        if not found.converged:
            continue
        assert ur5e.joint_box.contains(found.joint_positions)
        achieved = ur5e.forward_kinematics.poses(found.joint_positions[np.newaxis])
        distance, angle = pose_distance(pose[np.newaxis], achieved)
        distances.append(distance[0])
        angles.append(angle[0])
        steps.append(found.newton_steps)
        same += np.abs(found.joint_positions - joints).max() < SAME_SOLUTION
    refined = measured.summary().refined
    assert refined is not None
    assert refined.success == len(steps) / 200
    assert refined.same_solution == same / 200
    assert 0.9 < refined.same_solution <= refined.success
    assert refined.mean_steps == pytest.approx(np.mean(steps))
    assert (refined.p99_steps, refined.max_steps) == (np.percentile(steps, 99), max(steps))
    assert refined.position_residual == pytest.approx(max(distances), rel=1e-6)
    assert refined.position_residual <= RefinementOptions.tolerance
    assert refined.orientation_residual == pytest.approx(max(angles), rel=1e-6)
    assert refined.orientation_residual <= 1.01 * RefinementOptions.tolerance


def test_the_exact_inverse_takes_no_step(unseen: Dataset) -> None:
    refined = network_errors(lambda _: unseen.joint_positions, unseen).summary().refined
    assert refined is not None
    assert (refined.success, refined.same_solution, refined.max_steps) == (1.0, 1.0, 0)
    assert refined.position_residual < 1e-12


def test_another_solution_inside_the_box_is_a_success_that_is_not_the_same() -> None:
    """A planar arm that may bend its elbow either way, asked with the elbow bent the other way."""
    scara = load_robot("scara", joint_box={"joint2": [-2.4, 2.4]})
    unseen = random_dataset(scara, scara.joint_box, 60, seed=0)
    mirrored = unseen.joint_positions * [1.0, -1.0, 1.0, 1.0]
    mirrored[:, 0] += unseen.joint_positions[:, 1]
    refined = network_errors(lambda _: mirrored, unseen).summary().refined
    assert refined is not None
    assert refined.same_solution < refined.success - 0.3


@pytest.mark.parametrize("value", [0.0, 1e3, -1e12, 1e300])
def test_nonsense_is_measured_as_what_it_is(unseen: Dataset, value: float) -> None:
    """Fewer successes, joint positions outside the limits, finite numbers, and no exception."""
    evaluation = network_errors(lambda poses: np.full((len(poses), 6), value), unseen).summary()
    assert evaluation.refined is not None
    assert evaluation.refined.success < 1.0
    assert evaluation.outside_joint_limits == (0.0 if value == 0.0 else 1.0)
    written = json.dumps(evaluation.to_dict(), allow_nan=False)
    assert json.loads(written) == evaluation.to_dict()


def test_nothing_solved_is_all_zeros(ur5e: Robot) -> None:
    """Poses that no joint positions of the box lead to."""
    unseen = random_dataset(ur5e, ur5e.joint_box, 3, seed=0)
    unseen.poses[:, 0] += 5.0
    evaluation = network_errors(lambda _: unseen.joint_positions, unseen).summary()
    assert evaluation.refined is not None
    assert set(vars(evaluation.refined).values()) == {0}
    json.dumps(evaluation.to_dict(), allow_nan=False)


def test_plain_data_is_json_with_the_units_in_the_names(measured: NetworkErrors) -> None:
    data = measured.summary().to_dict()
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert set(data["refined"]) == {
        *("success", "same_solution", "mean_steps", "p99_steps", "max_steps"),
        *("position_residual_m", "orientation_residual_rad"),
    }


def test_what_a_node_does_not_refine_is_not_measured_refined(gantry: Robot) -> None:
    unseen = random_dataset(gantry, gantry.joint_box, 20, seed=0)
    measured = network_errors(lambda _: unseen.joint_positions, unseen)
    assert measured.refined is None
    assert "refined" not in measured.summary().to_dict()
