"""The fit: exact gradients, reproducible, honest about what it held out. ROS-free."""

from __future__ import annotations

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
from annik_training.fit import FitOptions, fit
from annik_training.network import HiddenLayers, Scaling
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
    assert fitted.held_out_examples == 15


def test_the_winner_is_the_network_that_is_returned(dataset: Dataset) -> None:
    """Alone, the winning start gives the same network."""
    options = FitOptions(restarts=3, max_evaluations=4)
    fitted = fit(dataset, options)
    errors = []
    for example in range(len(dataset)):
        answer = fitted.network.joint_positions(dataset.poses[example : example + 1])
        errors.append(answer - dataset.joint_positions[example])
    assert np.isfinite(errors).all()
    best = min(restart.held_out_error for restart in fitted.restarts)
    assert fitted.restarts[fitted.winner].held_out_error == best


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
        assert sum(fold.validation_examples for fold in folds) == len(dataset)
        assert all(np.isfinite(fold.validation_error) for fold in folds)

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
