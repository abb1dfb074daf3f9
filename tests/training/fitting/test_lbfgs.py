"""L-BFGS of all weights: derivatives, limits, the same bits for the same seed. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from annik_core.dataset import Dataset
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.registry import generate_dataset
from annik_training.fitting import lbfgs as quasi_newton
from annik_training.fitting.fit import dataset_examples, fit, scaled_examples, untrained_network
from annik_training.fitting.lbfgs import minimise_all_weights, outputs_and_derivatives
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem
from annik_training.fitting.variable_projection import ScaledExamples
from annik_training.networks.network import ScaledNetwork, Scaling

pytestmark = pytest.mark.usefixtures("one_thread")

OPTIONS = FitOptions(
    hidden_units=(6, 5),
    restarts=1,
    held_out_fraction=0.0,
    max_evaluations=12,
    linear_path=True,
    sobolev_weight=3.0,
    optimiser="lbfgs",
)


@pytest.fixture(scope="module")
def ur5e() -> Robot:
    return load_robot("ur5e")


@pytest.fixture(scope="module")
def dataset(ur5e: Robot) -> Dataset:
    return generate_dataset(ur5e, "sobol", 32, seed=0)


def prepared(dataset: Dataset, options: FitOptions) -> tuple[ScaledNetwork, ScaledExamples]:
    """An untrained network, every weight of it random, and the examples in its units."""
    examples = dataset_examples(InverseKinematicsSystem(dataset.robot), dataset, options)
    network = untrained_network(examples, np.arange(len(examples)), options)
    network.hidden.initialise(np.random.default_rng(0))
    torch.manual_seed(0)
    with torch.no_grad():
        for layer in (network.output, network.linear_path):
            if layer is not None:
                layer.weight.normal_()
    return network, scaled_examples(network, examples)


def square_error(network: ScaledNetwork, examples: ScaledExamples, sobolev_weight: float) -> float:
    with torch.no_grad():
        answers, derivatives = outputs_and_derivatives(
            network, examples.inputs, examples.directions
        )
        return float(
            torch.mean((answers - examples.targets) ** 2)
            + sobolev_weight * torch.mean((derivatives - examples.derivatives) ** 2)
        )


@pytest.mark.parametrize("hidden_units", [(7,), (6, 5), (4, 5, 6)])
@pytest.mark.parametrize("linear_path", [False, True])
def test_derivatives_are_the_derivatives_of_the_answers(
    hidden_units: tuple[int, ...], linear_path: bool
) -> None:
    """By torch's own Jacobian of the network, along any directions."""
    generator = torch.Generator().manual_seed(0)
    box = Scaling(-np.ones(5), np.ones(5))
    network = ScaledNetwork(
        hidden_units, box, Scaling(-np.ones(3), np.ones(3)), linear_path=linear_path
    )
    inputs = torch.rand(4, 5, dtype=torch.float64, generator=generator)
    directions = torch.rand(4, 2, 5, dtype=torch.float64, generator=generator)
    answers, derivatives = outputs_and_derivatives(network, inputs, directions)
    jacobians = torch.stack(
        [torch.func.jacrev(lambda one: network.scaled(one[None])[0])(row) for row in inputs]
    )
    assert torch.allclose(answers, network.scaled(inputs), rtol=0, atol=1e-14)
    expected = torch.einsum("nki,ndi->ndk", jacobians, directions)
    assert derivatives.shape == (4, 2, 3)
    assert torch.allclose(derivatives, expected, rtol=0, atol=1e-13)


def test_the_derivatives_are_fitted_too(dataset: Dataset) -> None:
    """With a weight on them they end nearer to the robot's than without."""
    off = {}
    for weight in (0.0, 10.0):
        network, examples = prepared(dataset, OPTIONS)
        minimise_all_weights(network, examples, weight, 60)
        with torch.no_grad():
            _, derivatives = outputs_and_derivatives(network, examples.inputs, examples.directions)
        off[weight] = float(torch.mean((derivatives - examples.derivatives) ** 2))
    assert off[10.0] < 0.5 * off[0.0]


def test_a_weight_of_zero_needs_no_derivatives(dataset: Dataset) -> None:
    """And computes none: with and without them it is the same fit, bit for bit."""
    trained = []
    for sobolev_weight in (0.0, 1.0):
        network, examples = prepared(dataset, replace(OPTIONS, sobolev_weight=sobolev_weight))
        assert (examples.derivatives is None) == (sobolev_weight == 0.0)
        minimise_all_weights(network, examples, 0.0, 10)
        trained.append(torch.nn.utils.parameters_to_vector(network.parameters()).detach())
    assert torch.equal(*trained)


@pytest.mark.parametrize("most", [*range(1, 14), 40])
def test_never_more_evaluations_than_allowed_and_never_worse_than_the_start(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """Counted where the error is computed; also where they end amid a line search."""
    network, examples = prepared(dataset, OPTIONS)
    start = square_error(network, examples, 3.0)
    counted = []

    def count(*arguments: object) -> object:
        counted.append(1)
        return outputs_and_derivatives(*arguments)

    monkeypatch.setattr(quasi_newton, "outputs_and_derivatives", count)
    assert minimise_all_weights(network, examples, 3.0, most) == len(counted) <= most
    end = square_error(network, examples, 3.0)
    assert end <= start * (1.0 + 1e-12)
    if most >= 10:
        assert end < 0.5 * start


def test_the_fit_says_how_many_evaluations_it_took(dataset: Dataset) -> None:
    for most in (1, 9):
        (restart,) = fit(dataset, replace(OPTIONS, max_evaluations=most)).restarts
        assert restart.evaluations == most


def test_the_same_seed_gives_the_same_bits_whatever_came_before(dataset: Dataset) -> None:
    """Another seed does not; and torch's own random numbers have no part in it."""
    first = fit(dataset, OPTIONS).network.joint_positions(dataset.poses)
    other = fit(dataset, replace(OPTIONS, seed=1)).network.joint_positions(dataset.poses)
    fit(dataset, replace(OPTIONS, optimiser="levenberg_marquardt", max_evaluations=1))
    torch.manual_seed(7)
    again = fit(dataset, OPTIONS).network.joint_positions(dataset.poses)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_it_starts_at_the_middle_of_the_box(dataset: Dataset) -> None:
    """After one evaluation, the start: every answer is the centre."""
    fitted = fit(dataset, replace(OPTIONS, max_evaluations=1))
    answers = fitted.network.joint_positions(dataset.poses)
    centre = np.tile(dataset.robot.joint_box.centre, (len(dataset), 1))
    assert answers == pytest.approx(centre, abs=1e-12)


def test_a_locked_joint_is_answered_exactly() -> None:
    """A box without width gives no derivative, and no division by zero."""
    panda = load_robot("panda")
    fitted = fit(generate_dataset(panda, "sobol", 16, seed=0), OPTIONS)
    answers = fitted.network.joint_positions(fitted.dataset.poses)
    assert np.isfinite(answers).all()
    assert np.array_equal(answers[:, 2], np.zeros(16))


def test_more_evaluations_fit_better(dataset: Dataset) -> None:
    errors = [
        fit(dataset, replace(OPTIONS, max_evaluations=most)).restarts[0].training_error
        for most in (1, 10, 100)
    ]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.2 * errors[0]
