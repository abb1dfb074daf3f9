"""The network from encoded poses to joint positions, and its form for export.

The network: tanh hidden layers, a linear output layer, and the scaling around them.

The same network in fewer operations, for the exported graph.

For one pose, onnxruntime takes about as long for each operation, however small. What is linear
between the products of the quaternion and the first layer, and after the last one, is therefore
multiplied out once, at export; the export is then proven against the network as it was trained.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from annik_core.pose import FloatArray
from annik_training.networks.encoding import PoseEncoding, PositionRotationMatrix

#: An axis narrower than this part of the widest has no width. On an arm whose end effector only
#: turns about the vertical, most of the rotation matrix is constant but for rounding: to scale
#: that up would make a network of it.
_NO_WIDTH = 1e-6


class HiddenLayers(nn.Module):
    """``(n, inputs)`` to ``(n, units)``: fully connected layers, each followed by tanh."""

    def __init__(self, inputs: int, units: Sequence[int]) -> None:
        super().__init__()
        sizes = [inputs, *units]
        self.layers = nn.ModuleList(
            nn.Linear(before, after, dtype=torch.float64) for before, after in pairwise(sizes)
        )

    def forward(self, scaled_inputs: Tensor) -> Tensor:
        """Activations of the last hidden layer."""
        activations = scaled_inputs
        for layer in self.layers:
            activations = torch.tanh(layer(activations))
        return activations

    def initialise(self, rng: np.random.Generator) -> None:
        """Draw weights from N(0, 1 / inputs) and biases from U(-1, 1).

        With inputs scaled to [-1, 1] this spreads the units' transitions over the box.
        """
        with torch.no_grad():
            for layer in self.layers:
                assert isinstance(layer, nn.Linear)
                weight = rng.normal(size=layer.weight.shape) / np.sqrt(layer.in_features)
                layer.weight.copy_(torch.from_numpy(weight))
                layer.bias.copy_(torch.from_numpy(rng.uniform(-1.0, 1.0, layer.out_features)))


class Scaling(nn.Module):
    """Maps a box to [-1, 1] and back, one axis at a time.

    Args:
        lower: ``(k,)`` the box; an axis on which it has no width is only shifted.
        upper: ``(k,)``.
    """

    centre: Tensor
    half_width: Tensor

    def __init__(self, lower: FloatArray, upper: FloatArray) -> None:
        super().__init__()
        half_width = 0.5 * (upper - lower)
        half_width = np.where(half_width > _NO_WIDTH * half_width.max(), half_width, 1.0)
        self.register_buffer("centre", torch.from_numpy(0.5 * (lower + upper)))
        self.register_buffer("half_width", torch.from_numpy(half_width))

    def scale(self, values: Tensor) -> Tensor:
        """``(n, k)`` in the units of the box to scaled values."""
        return (values - self.centre) / self.half_width

    def unscale(self, scaled: Tensor) -> Tensor:
        """Scaled values ``(n, k)`` to the units of the box."""
        return scaled * self.half_width + self.centre


class ScaledNetwork(nn.Module):
    """Scaling, tanh hidden layers, linear output, unscaling: y = W phi(x) + A x + b.

    Attributes:
        input_scaling: the box of the inputs.
        hidden: the hidden layers, phi.
        output: the linear output layer, W and b, in scaled outputs.
        linear_path: A, or None if the inputs reach the outputs through the hidden layers only.
        output_scaling: the box of the outputs.
    """

    def __init__(
        self,
        hidden_units: Sequence[int],
        input_scaling: Scaling,
        output_scaling: Scaling,
        *,
        linear_path: bool = False,
    ) -> None:
        super().__init__()
        inputs, outputs = len(input_scaling.centre), len(output_scaling.centre)
        self.input_scaling = input_scaling
        self.hidden = HiddenLayers(inputs, hidden_units)
        self.output = nn.Linear(hidden_units[-1], outputs, dtype=torch.float64)
        self.linear_path = (
            nn.Linear(inputs, outputs, bias=False, dtype=torch.float64) if linear_path else None
        )
        self.output_scaling = output_scaling

    def scaled(self, scaled_inputs: Tensor) -> Tensor:
        """Scaled outputs ``(n, outputs)`` for scaled inputs ``(n, inputs)``; float64."""
        answer: Tensor = self.output(self.hidden(scaled_inputs))
        return answer if self.linear_path is None else answer + self.linear_path(scaled_inputs)

    def forward(self, inputs: Tensor) -> Tensor:
        """Outputs ``(n, outputs)`` for inputs ``(n, inputs)``; float64."""
        return self.output_scaling.unscale(self.scaled(self.input_scaling.scale(inputs)))

    def predict(self, inputs: FloatArray) -> FloatArray:
        """The same for NumPy arrays."""
        with torch.no_grad():
            answer: FloatArray = self(torch.from_numpy(inputs)).numpy()
        return answer


class InverseKinematicsNetwork(nn.Module):
    """Poses in, joint positions out: the encoding, and the network behind it.

    This whole module is what the model file holds.

    Attributes:
        encoding: from poses to features.
        network: from features to joint positions.
    """

    def __init__(self, encoding: PoseEncoding, network: ScaledNetwork) -> None:
        super().__init__()
        self.encoding = encoding
        self.network = network

    def forward(self, pose: Tensor) -> Tensor:
        """Joint positions ``(n, dof)`` [rad or m] for poses ``(n, 7)``; float64."""
        joint_positions: Tensor = self.network(self.encoding(pose))
        return joint_positions

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """The same for NumPy arrays."""
        with torch.no_grad():
            answer: FloatArray = self(torch.from_numpy(poses)).numpy()
        return answer


class FusedNetwork(nn.Module):
    """Poses ``(n, 7)`` in, joint positions ``(n, dof)`` out; float64.

    The terms are the products of two linear functions of the pose each: x, y, z times one, and
    the ten products of two components of the quaternion.

    Args:
        encoding: of the network.
        network: the network behind it.
    """

    first_factor: Tensor
    second_factor: Tensor
    second_offset: Tensor

    def __init__(self, encoding: PositionRotationMatrix, network: ScaledNetwork) -> None:
        super().__init__()
        for name, value in zip(
            ("first_factor", "second_factor", "second_offset"), encoding.factors, strict=True
        ):
            self.register_buffer(name, value)
        with torch.no_grad():
            scaling = network.input_scaling
            # (terms, features), and what the features are shifted by, in scaled units.
            scale = encoding.terms_to_features / scaling.half_width
            shift = -scaling.centre / scaling.half_width
            first, *others = network.hidden.layers
            assert isinstance(first, nn.Linear)
            self.first = _linear(first.weight @ scale.T, first.bias + first.weight @ shift)
            self.others = nn.ModuleList(others)
            unscale = network.output_scaling.half_width[:, None]
            self.output = _linear(
                unscale * network.output.weight,
                unscale[:, 0] * network.output.bias + network.output_scaling.centre,
            )
            self.linear_path = None
            if network.linear_path is not None:
                path = unscale * network.linear_path.weight
                self.linear_path = _linear(path @ scale.T, path @ shift)

    def forward(self, pose: Tensor) -> Tensor:
        """Joint positions ``(n, dof)`` [rad or m] for poses ``(n, 7)``."""
        terms = (pose @ self.first_factor) * (pose @ self.second_factor + self.second_offset)
        activations = torch.tanh(self.first(terms))
        for layer in self.others:
            activations = torch.tanh(layer(activations))
        answer: Tensor = self.output(activations)
        return answer if self.linear_path is None else answer + self.linear_path(terms)


def for_export(network: InverseKinematicsNetwork) -> nn.Module:
    """The module to export: fused, where the encoding is linear in products of the pose."""
    if isinstance(network.encoding, PositionRotationMatrix):
        return FusedNetwork(network.encoding, network.network)
    return network


def _linear(weight: Tensor, bias: Tensor) -> nn.Linear:
    layer = nn.Linear(weight.shape[1], weight.shape[0], dtype=torch.float64)
    layer.weight.copy_(weight)
    layer.bias.copy_(bias)
    return layer
