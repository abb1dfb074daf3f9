"""The fit: exact gradients, reproducible, honest about what it held out. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import approx_fprime

from annik_core.errors import InvalidTrainingOption, TooFewExamples
from annik_core.pose import pose_difference
from annik_core.robot import Robot
from annik_training.cross_validation import cross_validate
from annik_training.dataset import Dataset, compute_dataset, compute_random_dataset
from annik_training.evaluation import ErrorSummary, evaluate
from annik_training.fit import FitOptions, fit, network_poses
from annik_training.network import HiddenLayers, InverseKinematicsNetwork, Scaling
from annik_training.separable_least_squares import SeparableProblem, fit_separable

QUICK = FitOptions(restarts=2, max_evaluations=8)


@pytest.fixture(scope="module")
def dataset(gantry: Robot) -> Dataset:
    return compute_dataset(gantry, "thirty_phase", 3, seed=0)


def problem(units: tuple[int, ...], seed: int = 0) -> tuple[SeparableProblem, np.ndarray]:
    rng = np.random.default_rng(seed)
    hidden = HiddenLayers(3, units)
    hidden.initialise(rng)
    inputs = torch.from_numpy(rng.uniform(-1, 1, (25, 3)))
    targets = torch.sin(2 * inputs[:, :2] * inputs[:, 1:])
    weights = torch.cat([p.detach().reshape(-1) for p in hidden.parameters()]).numpy()
    return SeparableProblem(hidden, inputs, targets, ridge=1e-3), weights


@pytest.mark.parametrize("units", [(4,), (5, 3)])
def test_gradient_of_the_sum_of_squares_is_exact(units: tuple[int, ...]) -> None:
    """Kaufman's Jacobian drops only what is orthogonal to the residual."""
    separable, weights = problem(units)
    gradient = separable.jacobian(weights).T @ separable.residual(weights)
    numerical = approx_fprime(
        weights, lambda w: 0.5 * np.sum(separable.residual(w) ** 2), epsilon=1e-7
    )
    assert gradient == pytest.approx(numerical, rel=1e-4, abs=1e-7)


def test_the_output_layer_is_the_least_squares_solution() -> None:
    """No other output weights leave a smaller residual: against NumPy's solver."""
    separable, weights = problem((4,))
    weight, bias = separable.output_layer(weights)
    stacked = separable._stacked(weights).numpy()
    expected = np.linalg.lstsq(stacked, separable._stacked_targets.numpy(), rcond=None)[0]
    assert weight.numpy() == pytest.approx(expected[:-1].T)
    assert bias.numpy() == pytest.approx(expected[-1])


def test_fitting_lowers_the_error_by_decades() -> None:
    rng = np.random.default_rng(0)
    inputs = torch.from_numpy(rng.uniform(-1, 1, (60, 2)))
    targets = torch.sin(2 * inputs)
    hidden = HiddenLayers(2, (10,))
    hidden.initialise(rng)
    start = fit_separable(hidden, inputs, targets, ridge=1e-7, max_evaluations=1)
    end = fit_separable(hidden, inputs, targets, ridge=1e-7, max_evaluations=60)
    assert end.mean_square_error < 1e-3 * start.mean_square_error


def test_more_weights_than_residuals_still_fit() -> None:
    """MINPACK refuses that; the fit does not."""
    rng = np.random.default_rng(0)
    inputs = torch.from_numpy(rng.uniform(-1, 1, (8, 6)))
    hidden = HiddenLayers(6, (40,))
    hidden.initialise(rng)
    result = fit_separable(hidden, inputs, inputs[:, :1], ridge=1e-6, max_evaluations=20)
    assert result.mean_square_error < 1e-6


def test_same_seed_same_network(dataset: Dataset) -> None:
    """Bit for bit on one machine; another seed gives another network."""
    poses = dataset.poses[:20]
    first = fit(dataset, QUICK).network.joint_positions(poses)
    again = fit(dataset, QUICK).network.joint_positions(poses)
    other = fit(dataset, FitOptions(restarts=2, max_evaluations=8, seed=1)).network
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other.joint_positions(poses))


def test_the_winner_has_the_smallest_held_out_error(dataset: Dataset) -> None:
    told = []
    fitted = fit(dataset, FitOptions(restarts=3, max_evaluations=4), told.append)
    assert tuple(told) == fitted.restarts
    errors = [restart.held_out_error for restart in fitted.restarts]
    assert fitted.winner == int(np.argmin(errors))
    assert len(fitted.held_out) == 15


def scaled_error(network: InverseKinematicsNetwork, dataset: Dataset, rows: np.ndarray) -> float:
    """Mean square error of a network on some examples, in scaled joint units."""
    answer = network.joint_positions(network_poses(dataset)[rows])
    half_width = 0.5 * (dataset.robot.joint_box.upper - dataset.robot.joint_box.lower)
    return float(np.mean(((answer - dataset.joint_positions[rows]) / half_width) ** 2))


def corrupted(dataset: Dataset, rows: np.ndarray) -> Dataset:
    """The dataset with some of its examples replaced by the centre of the box."""
    joint_positions = dataset.joint_positions.copy()
    joint_positions[rows] = dataset.robot.joint_box.centre
    poses = dataset.poses.copy()
    poses[rows] = dataset.robot.forward_kinematics.poses(joint_positions[rows])
    return replace(dataset, joint_positions=joint_positions, poses=poses)


def test_the_winner_is_the_network_that_is_returned(dataset: Dataset) -> None:
    """Its errors are those of the winning start, on the held-out examples and on the others."""
    fitted = fit(dataset, FitOptions(restarts=4, max_evaluations=4))
    winner = fitted.restarts[fitted.winner]
    others = np.setdiff1d(np.arange(len(dataset)), fitted.held_out)
    held_out_error = scaled_error(fitted.network, dataset, fitted.held_out)
    assert held_out_error == pytest.approx(winner.held_out_error, rel=1e-6)
    training_error = scaled_error(fitted.network, dataset, others)
    assert training_error == pytest.approx(winner.training_error, rel=1e-6)


def test_held_out_examples_have_no_part_in_a_start(dataset: Dataset) -> None:
    """Other held-out examples, the same network bit for bit."""
    options = FitOptions(restarts=1, max_evaluations=4)
    fitted = fit(dataset, options)
    again = fit(corrupted(dataset, fitted.held_out), options)
    assert np.array_equal(again.held_out, fitted.held_out)
    poses = dataset.poses[:20]
    assert np.array_equal(
        fitted.network.joint_positions(poses), again.network.joint_positions(poses)
    )
    assert again.restarts[0].held_out_error != fitted.restarts[0].held_out_error


def test_it_learns_the_robot_from_102_examples(gantry: Robot, dataset: Dataset) -> None:
    """Loosely: a hundredth of a millimetre is usual, a millimetre is a broken fit."""
    network = fit(dataset, FitOptions(restarts=2, max_evaluations=40)).network
    unseen = compute_random_dataset(gantry, gantry.joint_box, 500, seed=123)
    answer = network.joint_positions(unseen.poses)
    position, rotation = pose_difference(unseen.poses, gantry.forward_kinematics.poses(answer))
    assert np.linalg.norm(position, axis=1).max() < 1e-3
    assert np.linalg.norm(rotation, axis=1).max() < np.radians(0.2)


def test_too_few_examples(gantry: Robot, dataset: Dataset) -> None:
    few = Dataset(gantry, dataset.joint_positions[:7], dataset.poses[:7], "none", {}, 0)
    with pytest.raises(TooFewExamples, match="7 examples are too few"):
        fit(few, QUICK)


@pytest.mark.parametrize(
    "option",
    [
        {"hidden_units": ()},
        {"hidden_units": (0,)},
        {"restarts": 0},
        {"held_out_fraction": 0.0},
        {"held_out_fraction": 0.6},
        {"max_evaluations": 0},
        {"ridge": 0.0},
        {"ridge": float("nan")},
        {"seed": -1},
    ],
)
def test_an_option_out_of_range_is_named(option: dict[str, object]) -> None:
    with pytest.raises(InvalidTrainingOption, match=next(iter(option))):
        FitOptions(**option)


class TestCrossValidation:
    def test_every_example_is_validated_once(self, dataset: Dataset) -> None:
        folds = cross_validate(dataset, 4, QUICK)
        assert len(folds) == 4
        assert sorted(np.concatenate([fold.validation for fold in folds])) == list(
            range(len(dataset))
        )
        assert all(np.isfinite(fold.validation_error) for fold in folds)

    def test_a_fold_has_no_part_in_its_own_network(self, dataset: Dataset) -> None:
        folds = cross_validate(dataset, 4, QUICK)
        again = cross_validate(corrupted(dataset, folds[1].validation), 4, QUICK)
        poses = dataset.poses[:20]
        same = [
            np.array_equal(
                one.network.joint_positions(poses), other.network.joint_positions(poses)
            )
            for one, other in zip(folds, again, strict=True)
        ]
        assert same == [False, True, False, False]

    @pytest.mark.parametrize("folds", [1, 0, 103])
    def test_a_number_of_folds_out_of_range(self, dataset: Dataset, folds: int) -> None:
        with pytest.raises(InvalidTrainingOption, match="folds"):
            cross_validate(dataset, folds, QUICK)

    def test_too_few_examples_for_the_folds(self, gantry: Robot, dataset: Dataset) -> None:
        few = Dataset(gantry, dataset.joint_positions[:9], dataset.poses[:9], "none", {}, 0)
        with pytest.raises(TooFewExamples, match="folds"):
            cross_validate(few, 2, QUICK)


class TestEvaluation:
    def test_the_exact_inverse_has_no_error(self, gantry: Robot) -> None:
        unseen = compute_random_dataset(gantry, gantry.joint_box, 100, seed=1)
        evaluation = evaluate(lambda poses: unseen.joint_positions, unseen)
        assert evaluation.position_error.max < 1e-12
        assert evaluation.orientation_error.max < 1e-7
        assert evaluation.outside_joint_limits == 0.0

    def test_a_known_error_is_found(self, gantry: Robot) -> None:
        """Half a degree of the x drive is 5 mm, eq. (13)."""
        unseen = compute_random_dataset(gantry, gantry.joint_box, 100, seed=1)
        off = unseen.joint_positions + np.radians([0.5, 0, 0, 0, 0, 0])
        evaluation = evaluate(lambda poses: off, unseen)
        assert vars(evaluation.position_error) == pytest.approx(
            dict.fromkeys(("rms", "p50", "p95", "p99", "max"), 5e-3)
        )

    def test_a_known_rotation_error_is_found(self, gantry: Robot) -> None:
        """A tenth of a degree of the yaw drive turns the end effector by 0.3 degrees."""
        unseen = compute_random_dataset(gantry, gantry.joint_box, 100, seed=1)
        off = unseen.joint_positions + np.radians([0, 0, 0, 0, 0, 0.1])
        evaluation = evaluate(lambda poses: off, unseen)
        assert evaluation.orientation_error.p50 == pytest.approx(np.radians(0.3))
        assert evaluation.orientation_error.max == pytest.approx(np.radians(0.3))

    def test_answers_outside_the_limits_are_counted(self, gantry: Robot) -> None:
        unseen = compute_random_dataset(gantry, gantry.joint_box, 100, seed=1)
        answers = unseen.joint_positions.copy()
        answers[:25, 2] = 3.0
        assert evaluate(lambda poses: answers, unseen).outside_joint_limits == 0.25

    def test_summary_of_known_numbers(self) -> None:
        summary = ErrorSummary.of(np.arange(101.0))
        assert (summary.p50, summary.p95, summary.max) == (50.0, 95.0, 100.0)


def test_scaling_maps_the_box_to_one() -> None:
    scaling = Scaling(np.array([0.0, -2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    corners = torch.tensor([[0.0, -2.0, 3.0], [1.0, 2.0, 3.0]], dtype=torch.float64)
    scaled = scaling.scale(corners)
    assert scaled.tolist() == [[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]
    assert scaling.unscale(scaled).tolist() == corners.tolist()
