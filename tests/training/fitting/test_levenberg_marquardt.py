"""Levenberg-Marquardt finds minima, keeps to its limit, and repeats bit for bit. ROS-free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from annik_training.fitting.levenberg_marquardt import levenberg_marquardt

pytestmark = pytest.mark.usefixtures("one_thread")

Function = Callable[[np.ndarray], np.ndarray]


def rosenbrock(weights: np.ndarray) -> np.ndarray:
    x, y = weights
    return np.array([10.0 * (y - x**2), 1.0 - x])


def rosenbrock_derivatives(weights: np.ndarray) -> np.ndarray:
    return np.array([[-20.0 * weights[0], 10.0], [-1.0, 0.0]])


def decays(seed: int, count: int = 30) -> tuple[Function, Function, np.ndarray]:
    """Noisy measurements of a sum of two decays, to be fitted in four weights."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0, count)
    measured = 2.0 * np.exp(-t) - np.exp(-4.0 * t) + 0.01 * rng.normal(size=count)

    def residual(weights: np.ndarray) -> np.ndarray:
        a, b, c, d = weights
        return a * np.exp(-b * t) + c * np.exp(-d * t) - measured

    def jacobian(weights: np.ndarray) -> np.ndarray:
        a, b, c, d = weights
        one, other = np.exp(-b * t), np.exp(-d * t)
        return np.column_stack([one, -a * t * one, other, -c * t * other])

    return residual, jacobian, np.array([1.0, 0.5, -0.5, 3.0]) + 0.2 * rng.normal(size=4)


@pytest.mark.parametrize("seed", range(5))
def test_it_finds_the_minimum_that_minpack_finds(seed: int) -> None:
    residual, jacobian, start = decays(seed)
    weights, evaluations = levenberg_marquardt(residual, jacobian, start, 200)
    expected = least_squares(residual, start, jacobian, method="lm", xtol=1e-12, ftol=1e-12)
    assert np.sum(residual(weights) ** 2) == pytest.approx(2.0 * expected.cost, rel=1e-9)
    assert weights == pytest.approx(expected.x, rel=1e-4)
    assert evaluations <= 3 * expected.nfev


def test_it_follows_rosenbrocks_valley() -> None:
    weights, evaluations = levenberg_marquardt(
        rosenbrock, rosenbrock_derivatives, np.array([-1.2, 1.0]), 100
    )
    assert weights == pytest.approx([1.0, 1.0], abs=1e-9)
    assert evaluations < 60


@pytest.mark.parametrize("rows", [9, 4, 3])
def test_a_linear_problem_takes_few_steps(rows: int) -> None:
    """More numbers than weights, as many, and fewer."""
    rng = np.random.default_rng(0)
    matrix, right = rng.normal(size=(rows, 4)), rng.normal(size=rows)
    weights, evaluations = levenberg_marquardt(
        lambda weights: matrix @ weights - right, lambda _: matrix, np.zeros(4), 30
    )
    best = np.linalg.lstsq(matrix, right, rcond=None)[0]
    assert matrix @ weights == pytest.approx(matrix @ best, abs=1e-9)
    assert evaluations < 15


def test_weights_without_effect_do_not_stop_the_others() -> None:
    """One appears nowhere, and two only as their sum."""
    matrix = np.array([[1.0, 0.0, 1.0, 1.0], [2.0, 0.0, -1.0, -1.0], [0.0, 0.0, 3.0, 3.0]])
    weights, _ = levenberg_marquardt(
        lambda weights: matrix @ weights - 1.0, lambda _: matrix, np.ones(4), 30
    )
    best = matrix @ np.linalg.lstsq(matrix, np.ones(3), rcond=None)[0]
    assert matrix @ weights == pytest.approx(best, abs=1e-9)
    assert weights[1] == 1.0


@pytest.mark.parametrize("most", [1, 2, 3, 10])
def test_evaluations_are_counted_and_no_more_than_allowed(most: int) -> None:
    residual, jacobian, start = decays(0)
    asked = []

    def counted(weights: np.ndarray) -> np.ndarray:
        asked.append(weights.copy())
        return residual(weights)

    weights, evaluations = levenberg_marquardt(counted, jacobian, start, most)
    assert evaluations == len(asked) == most
    assert np.array_equal(asked[0], start)
    costs = [np.sum(residual(at) ** 2) for at in asked]
    assert np.sum(residual(weights) ** 2) == min(costs)


def test_the_sum_of_squares_never_rises() -> None:
    residual, jacobian, start = decays(3)
    costs = [
        np.sum(residual(levenberg_marquardt(residual, jacobian, start, most)[0]) ** 2)
        for most in range(1, 30)
    ]
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < 0.1 * costs[0]


@pytest.mark.parametrize("seed", range(5))
def test_it_ends_by_itself_at_a_minimum(seed: int) -> None:
    """Soon; and from there at once, though rounding still lets it lower the last digits."""
    residual, jacobian, start = decays(seed)
    weights, evaluations = levenberg_marquardt(residual, jacobian, start, 1000)
    assert evaluations < 25
    assert np.abs(jacobian(weights).T @ residual(weights)).max() < 1e-6
    assert levenberg_marquardt(residual, jacobian, weights, 1000)[1] < 20


def test_it_ends_where_no_residual_is_left() -> None:
    weights, evaluations = levenberg_marquardt(
        rosenbrock, rosenbrock_derivatives, np.ones(2), 1000
    )
    assert (weights.tolist(), evaluations) == ([1.0, 1.0], 1)


def test_a_step_to_where_there_are_no_numbers_is_shortened() -> None:
    """log(x) = 1 from far above, where the whole step leads below zero."""
    with np.errstate(invalid="ignore", divide="ignore"):
        weights, _ = levenberg_marquardt(
            lambda x: np.log(x) - 1.0, lambda x: np.diag(1.0 / x), np.array([50.0]), 100
        )
    assert weights == pytest.approx([np.e])


def test_the_start_is_left_as_it_is() -> None:
    residual, jacobian, start = decays(0)
    before = start.copy()
    levenberg_marquardt(residual, jacobian, start, 10)
    assert np.array_equal(start, before)


def test_same_start_same_bits() -> None:
    """Also for a Jacobian that is rank deficient to the last digit, wherever memory lies."""
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(60, 5)) @ rng.normal(size=(5, 40))
    right, start = rng.normal(size=60), rng.normal(size=40)

    def residual(weights: np.ndarray) -> np.ndarray:
        return np.tanh(matrix @ weights) - right

    def jacobian(weights: np.ndarray) -> np.ndarray:
        return (1.0 - np.tanh(matrix @ weights) ** 2)[:, np.newaxis] * matrix

    first, _ = levenberg_marquardt(residual, jacobian, start, 15)
    for size in range(1, 9):
        between = np.ones(size)  # so that the next arrays lie elsewhere
        again, _ = levenberg_marquardt(residual, jacobian, start, 15)
        assert np.array_equal(first, again)
        del between
