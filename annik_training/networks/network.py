"""The network from poses to joint positions, and the ONNX graph that it becomes.

Encoding, scaling, tanh hidden layers, linear output layer, scaling back. On one pose, onnxruntime
takes about as long for a scaling as for a layer, so a :class:`FusedNetwork` is exported: what
is linear between the encoding and the first layer, and after the last one, is multiplied out.
"""

import warnings
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from annik_core.model.graph import FEATURES_NAME, INPUT_NAME, OUTPUT_NAME
from annik_core.pose import FloatArray
from annik_training.networks.encoding import PoseEncoding

#: ONNX operator set: the newest that onnxruntime 1.18 supports completely.
OPSET = 20

#: An axis narrower than this part of the widest has no width. Where an end effector only turns
#: about the vertical, most of the rotation matrix is constant but for rounding, which must not be
#: scaled up to a signal.
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
    """Maps a box, lower and upper bounds ``(k,)``, to [-1, 1] and back, one axis at a time.

    An axis on which the box has no width is only shifted.
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
    """Scaling, tanh hidden layers, linear output, unscaling: y = W phi(x) + A x + b."""

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
        self.input_scaling = input_scaling  #: the box of the inputs
        self.hidden = HiddenLayers(inputs, hidden_units)  #: the hidden layers, phi
        #: The linear output layer, W and b, in scaled outputs.
        self.output = nn.Linear(hidden_units[-1], outputs, dtype=torch.float64)
        #: A, or None if the inputs reach the outputs through the hidden layers only.
        self.linear_path = (
            nn.Linear(inputs, outputs, bias=False, dtype=torch.float64) if linear_path else None
        )
        self.output_scaling = output_scaling  #: the box of the outputs

    def scaled(self, scaled_inputs: Tensor) -> Tensor:
        """Scaled outputs ``(n, outputs)`` for scaled inputs ``(n, inputs)``; float64."""
        outputs: Tensor = self.output(self.hidden(scaled_inputs))
        return outputs if self.linear_path is None else outputs + self.linear_path(scaled_inputs)

    def forward(self, inputs: Tensor) -> Tensor:
        """Outputs ``(n, outputs)`` for inputs ``(n, inputs)``; float64."""
        return self.output_scaling.unscale(self.scaled(self.input_scaling.scale(inputs)))

    def predict(self, inputs: FloatArray) -> FloatArray:
        """:meth:`forward` for NumPy arrays."""
        with torch.no_grad():
            outputs: FloatArray = self(torch.from_numpy(inputs)).numpy()
        return outputs


class InverseKinematicsNetwork(nn.Module):
    """Poses ``(n, 7)`` to joint positions ``(n, dof)``: the encoding, then the network."""

    def __init__(self, encoding: PoseEncoding, network: ScaledNetwork) -> None:
        super().__init__()
        self.encoding = encoding
        self.network = network

    def forward(self, pose: Tensor) -> Tensor:
        """Joint positions ``(n, dof)`` [rad or m] for poses ``(n, 7)``; float64."""
        joint_positions: Tensor = self.network(self.encoding(pose))
        return joint_positions

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """:meth:`forward` for NumPy arrays."""
        with torch.no_grad():
            joint_positions: FloatArray = self(torch.from_numpy(poses)).numpy()
        return joint_positions

    @torch.no_grad()
    def fused(self) -> "FusedNetwork":
        """An equal network of fewer operators; its weights are new tensors."""
        network = self.network
        scaling = network.input_scaling
        # (terms, features), and the shift of the features, in scaled units.
        scale = self.encoding.terms_to_features / scaling.half_width
        shift = -scaling.centre / scaling.half_width
        first, *others = network.hidden.layers
        assert isinstance(first, nn.Linear)
        unscale = network.output_scaling.half_width[:, None]
        bias = unscale[:, 0] * network.output.bias + network.output_scaling.centre
        linear_path = None
        if network.linear_path is not None:
            path = unscale * network.linear_path.weight
            linear_path = linear_layer(path @ scale.T, path @ shift + bias)
            bias = torch.zeros_like(bias)
        return FusedNetwork(
            self.encoding,
            [linear_layer(first.weight @ scale.T, first.bias + first.weight @ shift), *others],
            linear_layer(unscale * network.output.weight, bias),
            linear_path,
        )

    def as_onnx(self) -> onnx.ModelProto:
        """The graph of a model file, see :meth:`FusedNetwork.as_onnx`."""
        return self.fused().as_onnx()


class FusedNetwork(nn.Module):
    """Poses ``(n, 7)`` to joint positions ``(n, dof)``: the network of a model file; float64.

    The terms of the encoding are the features of the file. The hidden layers are each followed by
    tanh; the output is linear in the last of them and, by the linear path, in the terms. The
    linear path then has the bias of both, so that the sum is one operator of the graph.
    """

    def __init__(
        self,
        encoding: PoseEncoding,
        hidden: Iterable[nn.Module],
        output: nn.Linear,
        linear_path: nn.Linear | None,
    ) -> None:
        super().__init__()
        self.encoding = encoding
        self.hidden = nn.ModuleList(hidden)
        self.output = output
        self.linear_path = linear_path

    def forward(self, pose: Tensor) -> tuple[Tensor, Tensor]:
        """Joint positions ``(n, dof)`` [rad or m] and features ``(n, t)`` for ``(n, 7)``."""
        features = self.encoding.terms(pose)
        activations = features
        for layer in self.hidden:
            activations = torch.tanh(layer(activations))
        if self.linear_path is None:
            joint_positions: Tensor = self.output(activations)
        else:
            direct = self.linear_path(features)
            joint_positions = torch.addmm(direct, activations, self.output.weight.T)
        return joint_positions, features

    def as_onnx(self) -> onnx.ModelProto:
        """The ONNX graph: input ``pose``, output ``joint_positions``, a tensor ``features``."""
        example = torch.tensor([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]] * 2, dtype=torch.float64)
        with TemporaryDirectory() as folder, warnings.catch_warnings():
            path = Path(folder, "model.onnx")
            # This exporter is deprecated; the new one takes fifty times as long.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                self.eval(),
                (example,),
                path,
                input_names=[INPUT_NAME],
                output_names=[OUTPUT_NAME, FEATURES_NAME],
                dynamic_axes={name: {0: "n"} for name in (INPUT_NAME, OUTPUT_NAME, FEATURES_NAME)},
                opset_version=OPSET,
                dynamo=False,
            )
            model = onnx.load(path)
        # Exported as an output for its name; a model file has one output.
        model.graph.value_info.append(model.graph.output.pop())
        _remove_constant_nodes(model.graph)
        return model


def linear_layer(weight: Tensor, bias: Tensor) -> nn.Linear:
    """A layer with copies of a weight ``(m, n)`` and a bias ``(m,)``."""
    layer = nn.Linear(weight.shape[1], weight.shape[0], dtype=torch.float64)
    with torch.no_grad():
        layer.weight.copy_(weight)
        layer.bias.copy_(bias)
    return layer


def _remove_constant_nodes(graph: onnx.GraphProto) -> None:
    """Make initializers of constants, which the exporter writes as operators."""
    for node in [node for node in graph.node if node.op_type == "Constant"]:
        constant = node.attribute[0].t
        constant.name = node.output[0]
        graph.initializer.append(constant)
        graph.node.remove(node)
