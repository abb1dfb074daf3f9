"""The graph of a model file: its names, what it may hold, and the part after the encoding.

The checks go by what is in the file, not by what it says of itself.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx

from annik_core.model.errors import InvalidGraph, InvalidMetadata, UnreadableModel

INPUT_NAME = "pose"
OUTPUT_NAME = "joint_positions"
#: The tensor in which the encoding of the pose ends, as annik writes it.
FEATURES_NAME = "features"

#: Operators of ONNX's own domain that a graph may use. With these it has no weights that the
#: checks do not see, no randomness, and no memory from call to call. A new encoding may add to
#: them, if that stays true.
# fmt: off
OPERATORS = frozenset({
    # Those of the packaged models.
    "Abs", "Add", "Atan", "Cast", "Concat", "Cos", "Div", "Gemm", "Less", "MatMul", "Max", "Mul",
    "Round", "Sin", "Slice", "Sqrt", "Sub", "Tanh", "Where",
    # The same, as another version of torch's exporter may write it.
    "Constant", "Gather", "Identity", "Reshape", "Squeeze", "Transpose", "Unsqueeze",
    # Plain arithmetic, for other encodings and activations.
    "Acos", "And", "Asin", "Ceil", "Clip", "Equal", "Exp", "Floor", "Greater", "GreaterOrEqual",
    "LessOrEqual", "Log", "Min", "Neg", "Not", "Or", "Pow", "Reciprocal", "ReduceSum", "Relu",
    "Sigmoid", "Sign", "Tan",
})
# fmt: on

_DOMAINS = ("", "ai.onnx")
_TENSOR_TYPES = (
    onnx.TensorProto.DOUBLE,
    onnx.TensorProto.FLOAT,
    onnx.TensorProto.INT64,
    onnx.TensorProto.INT32,
    onnx.TensorProto.BOOL,
)


def parsed_graph(content: bytes, path: Path) -> onnx.ModelProto:
    """Parse the bytes of a model file; raise UnreadableModel if not ONNX, or truncated."""
    try:
        model = onnx.load_model_from_string(content)
    # The protobuf library's DecodeError has moved between its versions.
    except Exception as error:
        raise UnreadableModel(path, "not an ONNX file, or truncated") from error
    if not model.HasField("graph") or not model.graph.node:
        raise UnreadableModel(path, "not an ONNX file, or truncated: it has no graph")
    return model


def check_graph(model: onnx.ModelProto, path: Path) -> None:
    """Raise InvalidGraph for what other checks can't see into, and for numbers not finite."""
    if model.functions:
        raise InvalidGraph(path, model.functions[0].name, "is a function of its own")
    for sparse in model.graph.sparse_initializer:
        raise InvalidGraph(path, sparse.values.name, "is a sparse tensor")
    for tensor in model.graph.initializer:
        _check_tensor(tensor, path)
    for node in model.graph.node:
        if node.domain not in _DOMAINS or node.op_type not in OPERATORS:
            operator = f"{node.domain}.{node.op_type}" if node.domain else node.op_type
            raise InvalidGraph(path, operator, "is not an operator that a model uses")
        for attribute in node.attribute:
            _check_attribute(attribute, path)


def graph_properties(model: onnx.ModelProto, path: Path) -> dict[str, str]:
    """The metadata properties of a file; raise InvalidMetadata if two have one name."""
    properties: dict[str, str] = {}
    for entry in model.metadata_props:
        if entry.key in properties:
            # Which of them counts would depend on the reader.
            raise InvalidMetadata(path, entry.key.removeprefix("annik."), "there more than once")
        properties[entry.key] = entry.value
    return properties


def nodes_after(features: str, model: onnx.ModelProto, path: Path) -> list[onnx.NodeProto]:
    """The nodes of an accepted graph from the tensor ``features`` to the output, in order.

    Raises:
        InvalidMetadata: if the output is not a function of that tensor alone.
    """
    constants = {"", *(tensor.name for tensor in model.graph.initializer)}
    needed = {OUTPUT_NAME}
    nodes = []
    for node in reversed(model.graph.node):
        outputs = set(node.output)
        if features not in outputs and needed & outputs:
            nodes.append(node)
            needed = (needed - outputs) | (set(node.input) - constants)
    if features == INPUT_NAME or not nodes or needed != {features}:
        problem = f"{OUTPUT_NAME!r} is not a function of the tensor {features!r} alone"
        raise InvalidMetadata(path, "features", problem)
    return nodes[::-1]


def graph_of(
    nodes: list[onnx.NodeProto], features: str, model: onnx.ModelProto
) -> onnx.ModelProto:
    """A graph of :func:`nodes_after` one tensor, which is its input ``(n, m)``."""
    part = onnx.ModelProto(ir_version=model.ir_version, opset_import=model.opset_import)
    used = {name for node in nodes for name in node.input}
    part.graph.name = features
    part.graph.node.extend(nodes)
    part.graph.initializer.extend(t for t in model.graph.initializer if t.name in used)
    kind = onnx.TensorProto.DOUBLE
    part.graph.input.append(onnx.helper.make_tensor_value_info(features, kind, ["n", None]))
    part.graph.output.extend(model.graph.output)
    return part


def _check_attribute(attribute: onnx.AttributeProto, path: Path) -> None:
    # By the fields, not by the type that the attribute claims to have.
    if (
        any(attribute.HasField(field) for field in ("g", "sparse_tensor", "tp"))
        or any((attribute.graphs, attribute.tensors, attribute.sparse_tensors))
        or attribute.type_protos
    ):
        raise InvalidGraph(path, attribute.name, "is an attribute that is not numbers or text")
    if attribute.HasField("t"):
        _check_tensor(attribute.t, path)
    if not np.isfinite([attribute.f, *attribute.floats]).all():
        raise InvalidGraph(path, attribute.name, "holds a number that is not finite")


def _check_tensor(tensor: onnx.TensorProto, path: Path) -> None:
    if tensor.data_location == onnx.TensorProto.EXTERNAL:
        raise InvalidGraph(path, tensor.name, "is a tensor stored outside the file")
    if tensor.data_type not in _TENSOR_TYPES:
        problem = f"is a tensor of type {tensor.data_type}, which no model uses"
        raise InvalidGraph(path, tensor.name, problem)
    try:
        values = onnx.numpy_helper.to_array(tensor)
    except (ValueError, TypeError, RuntimeError) as error:
        raise InvalidGraph(path, tensor.name, "is a damaged tensor") from error
    if not np.isfinite(values).all():
        raise InvalidGraph(path, tensor.name, "holds a number that is not finite")
