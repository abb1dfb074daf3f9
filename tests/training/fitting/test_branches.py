"""One branch to learn: second solutions are left out, an only solution is not. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from annik_core.dataset import Dataset
from annik_core.pose import pose_distance
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.solver.refinement import Refinement
from annik_core.solver.result import RefinementOptions
from annik_training.designs.registry import generate_dataset, random_dataset
from annik_training.fitting.branches import branch_signs, single_branch
from annik_training.fitting.fit import fit
from annik_training.fitting.options import FitOptions

QUICK = FitOptions(
    hidden_units=(4,), restarts=1, max_evaluations=2, held_out_fraction=0.2, optimiser="lbfgs"
)


@pytest.fixture(scope="module")
def ur5e() -> Robot:
    return load_robot("ur5e")


@pytest.fixture(scope="module")
def dataset(ur5e: Robot) -> Dataset:
    return random_dataset(ur5e, ur5e.joint_box, 800, seed=0)


@pytest.fixture(scope="module")
def kept(ur5e: Robot, dataset: Dataset) -> np.ndarray:
    return single_branch(ur5e, dataset.joint_positions, dataset.poses)


def on_main_branch(robot: Robot, pose: np.ndarray, attempts: int) -> np.ndarray | None:
    """A solution on the main branch of the box, looked for from random joint positions."""
    box = robot.joint_box
    starts = np.random.default_rng(1).uniform(box.lower, box.upper, (attempts, robot.dof))
    search = Refinement(robot.forward_kinematics, box, RefinementOptions(max_newton_steps=40))
    for start in starts:
        found = search.refine(start, pose)
        if found.converged and branch_signs(robot, found.joint_positions[np.newaxis])[0] > 0:
            return found.joint_positions
    return None


def test_the_sign_is_that_of_the_determinant_and_changes_at_the_fold(ur5e: Robot) -> None:
    """Here at the stretched elbow, in front of the base; no joint limit is asked."""
    bent = np.tile(ur5e.joint_box.centre, (2, 1))
    bent[:, 1] = -0.6
    bent[:, 2] = 0.5, -0.5
    assert branch_signs(ur5e, bent).tolist() in ([1.0, -1.0], [-1.0, 1.0])


def test_second_solutions_are_left_out(ur5e: Robot, dataset: Dataset, kept: np.ndarray) -> None:
    """Each that is has another solution inside the box, on the branch of the most."""
    signs = branch_signs(ur5e, dataset.joint_positions)
    left_out = np.flatnonzero(~kept)
    assert len(left_out) >= 3
    assert np.mean(signs > 0) > 0.9
    assert (signs[left_out] < 0).all()
    for row in left_out:
        main = on_main_branch(ur5e, dataset.poses[row], 200)
        assert main is not None
        assert ur5e.joint_box.contains(main)
        distance, angle = pose_distance(
            dataset.poses[[row]], ur5e.forward_kinematics.poses(main[np.newaxis])
        )
        assert max(distance[0], angle[0]) < 1e-6
        assert np.abs(main - dataset.joint_positions[row]).max() > 1e-3


def test_an_only_solution_stays(ur5e: Robot, dataset: Dataset, kept: np.ndarray) -> None:
    """Beyond the fold; but what the main branch does not reach in the box has to be learned."""
    beyond = branch_signs(ur5e, dataset.joint_positions) < 0
    only = np.flatnonzero(beyond & kept)
    assert len(only) >= 5
    for row in only[:4]:
        assert on_main_branch(ur5e, dataset.poses[row], 60) is None


def test_the_main_branch_is_that_of_the_most(ur5e: Robot, dataset: Dataset) -> None:
    """Shown mostly the other, the other is learned, and the main one's rows are looked at."""
    signs = branch_signs(ur5e, dataset.joint_positions)
    rows = np.concatenate([np.flatnonzero(signs < 0), np.flatnonzero(signs > 0)[:5]])
    shown = dataset.rows(np.isin(np.arange(len(dataset)), rows))
    kept = single_branch(ur5e, shown.joint_positions, shown.poses)
    assert kept[branch_signs(ur5e, shown.joint_positions) < 0].all()


@pytest.mark.parametrize("name", ["iiwa14", "panda", "puma560", "scara", "xarm6"])
def test_other_arms_lose_nothing(name: str) -> None:
    """Their boxes are on one branch, or, with four joints, have no such sign."""
    robot = load_robot(name)
    dataset = random_dataset(robot, robot.joint_box, 200, seed=0)
    assert (branch_signs(robot, dataset.joint_positions) is None) == (name == "scara")
    assert single_branch(robot, dataset.joint_positions, dataset.poses).all()


def test_the_gantry_has_one_branch_and_is_fitted_to_every_example(gantry: Robot) -> None:
    dataset = generate_dataset(gantry, "thirty_phase", 3, seed=0)
    assert branch_signs(gantry, dataset.joint_positions) is None
    assert single_branch(gantry, dataset.joint_positions, dataset.poses).all()
    fitted = fit(dataset, FitOptions(hidden_units=(3,), restarts=1, max_evaluations=1))
    assert fitted.second_solutions == 0


def test_held_out_examples_are_rows_of_the_dataset_as_it_was_given(
    dataset: Dataset, kept: np.ndarray
) -> None:
    """None of them is one that was left out, and altering them alters nothing but their error."""
    some = np.zeros(len(dataset), dtype=bool)
    # Second solutions first, so that the rows of what is learned are shifted.
    some[np.flatnonzero(~kept)[:3]] = True
    some[
        np.flatnonzero(kept & (branch_signs(dataset.robot, dataset.joint_positions) > 0))[:40]
    ] = True
    shown = dataset.rows(some)
    learned = kept[some]
    fitted = fit(shown, QUICK)
    assert fitted.second_solutions == 3
    assert fitted.dataset is shown
    assert len(fitted.held_out) == 8
    assert learned[fitted.held_out].all()
    # A little, or the branch would be another.
    moved = shown.joint_positions.copy()
    moved[fitted.held_out] += 1e-6
    again = fit(
        replace(
            shown,
            joint_positions=moved,
            poses=shown.robot.forward_kinematics.poses(moved),
        ),
        QUICK,
    )
    assert np.array_equal(again.held_out, fitted.held_out)
    assert np.array_equal(
        again.network.joint_positions(shown.poses), fitted.network.joint_positions(shown.poses)
    )
    assert again.restarts[0].held_out_error != fitted.restarts[0].held_out_error
