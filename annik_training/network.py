"""The network: tanh hidden layers, a linear output layer, and the scaling around them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from annik_core.pose import FloatArray
from annik_training.pose_encoding import PoseEncoding


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
        half_width = np.where(half_width > 0, half_width, 1.0)
        self.register_buffer("centre", torch.from_numpy(0.5 * (lower + upper)))
        self.register_buffer("half_width", torch.from_numpy(half_width))

    def scale(self, values: Tensor) -> Tensor:
        """``(n, k)`` in the units of the box to scaled values."""
        return (values - self.centre) / self.half_width

    def unscale(self, scaled: Tensor) -> Tensor:
        """Scaled values ``(n, k)`` to the units of the box."""
        return scaled * self.half_width + self.centre


class InverseKinematicsNetwork(nn.Module):
    """Poses in, joint positions out: encoding, scaling, hidden layers, linear output, unscaling.

    This whole module is what the model file holds.

    Attributes:
        encoding: from poses to features.
        feature_scaling: the box of the features.
        hidden: the hidden layers.
        output: the linear output layer, in scaled joint positions.
        joint_scaling: the joint box.
    """

    def __init__(
        self,
        encoding: PoseEncoding,
        hidden_units: Sequence[int],
        feature_scaling: Scaling,
        joint_scaling: Scaling,
    ) -> None:
        super().__init__()
        self.encoding = encoding
        self.feature_scaling = feature_scaling
        self.hidden = HiddenLayers(encoding.features, hidden_units)
        joints = len(joint_scaling.centre)
        self.output = nn.Linear(hidden_units[-1], joints, dtype=torch.float64)
        self.joint_scaling = joint_scaling

    def forward(self, pose: Tensor) -> Tensor:
        """Joint positions ``(n, dof)`` [rad or m] for poses ``(n, 7)``; float64."""
        scaled_features = self.feature_scaling.scale(self.encoding(pose))
        return self.joint_scaling.unscale(self.output(self.hidden(scaled_features)))

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """The same for NumPy arrays."""
        with torch.no_grad():
            answer: FloatArray = self(torch.from_numpy(poses)).numpy()
        return answer
