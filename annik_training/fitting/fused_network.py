"""The same network in fewer operations, for the exported graph.

For one pose, onnxruntime takes about as long for each operation, however small. What is linear
between the products of the quaternion and the first layer, and after the last one, is therefore
multiplied out once, at export; the export is then proven against the network as it was trained.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from annik_training.fitting.network import InverseKinematicsNetwork, ScaledNetwork
from annik_training.fitting.pose_encoding import PositionRotationMatrix


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
