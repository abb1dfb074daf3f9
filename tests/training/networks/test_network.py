"""Scaling, hidden layers and the linear path around them. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from annik_training.networks.network import HiddenLayers, ScaledNetwork, Scaling


def test_scaling_maps_the_box_to_one() -> None:
    scaling = Scaling(np.array([0.0, -2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    corners = torch.tensor([[0.0, -2.0, 3.0], [1.0, 2.0, 3.0]], dtype=torch.float64)
    scaled = scaling.scale(corners)
    assert scaled.tolist() == [[-1.0, -1.0, 0.0], [1.0, 1.0, 0.0]]
    assert scaling.unscale(scaled).tolist() == corners.tolist()


@pytest.mark.parametrize("linear_path", [False, True])
def test_the_network_is_the_formula(linear_path: bool) -> None:
    """W tanh(U2 tanh(U1 x + c1) + c2) + A x + b, in scaled units, by NumPy."""
    rng = np.random.default_rng(0)
    lower, upper = np.array([0.0, -2.0, 5.0]), np.array([1.0, 2.0, 105.0])
    low, high = np.array([-1.0, 10.0]), np.array([3.0, 10.5])
    network = ScaledNetwork(
        (5, 4), Scaling(lower, upper), Scaling(low, high), linear_path=linear_path
    )
    network.hidden.initialise(rng)
    inputs = rng.uniform(lower, upper, (7, 3))
    layer = {name: value.detach().numpy() for name, value in network.named_parameters()}

    x = 2.0 * (inputs - lower) / (upper - lower) - 1.0
    phi = np.tanh(x @ layer["hidden.layers.0.weight"].T + layer["hidden.layers.0.bias"])
    phi = np.tanh(phi @ layer["hidden.layers.1.weight"].T + layer["hidden.layers.1.bias"])
    y = phi @ layer["output.weight"].T + layer["output.bias"]
    if linear_path:
        y = y + x @ layer["linear_path.weight"].T
    assert network.predict(inputs) == pytest.approx(low + (y + 1.0) * (high - low) / 2.0)
    assert ("linear_path.weight" in layer) == linear_path


def test_starts_spread_the_units_over_the_box() -> None:
    """Weights of variance 1 / inputs, biases between -1 and 1."""
    hidden = HiddenLayers(100, (400,))
    hidden.initialise(np.random.default_rng(0))
    weight, bias = (value.detach().numpy() for value in hidden.parameters())
    assert weight.mean() == pytest.approx(0.0, abs=1e-3)
    assert weight.std() == pytest.approx(0.1, rel=0.02)
    assert -1.0 <= bias.min() < -0.95
    assert 0.95 < bias.max() <= 1.0
