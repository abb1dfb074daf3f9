"""Make one layer of neighbours that are linear: a scaling costs onnxruntime as much as a layer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import onnx

from annik_core.pose import FloatArray

#: What a layer is here, as torch exports it: x matrix^T + offset.
_LAYER = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 1}


class _Linear(NamedTuple):
    """Rows x become x matrix^T + offset."""

    matrix: FloatArray
    offset: FloatArray


# A factor of 0 or 1e300 is for who compares the answers to find.
@np.errstate(all="ignore")
def with_linear_layers(model: onnx.ModelProto) -> onnx.ModelProto | None:
    """A graph equal to a chain of layers and scalings, but for rounding, with fewer operators.

    Args:
        model: a checked graph from rows of numbers to rows of numbers.

    Returns:
        The graph; None if the model is no such chain.
    """
    graph = model.graph
    constants = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in graph.initializer}
    nodes: list[onnx.NodeProto] = []
    tensors: list[onnx.TensorProto] = []
    # What the new nodes have come to, what the old ones have, and what is between the two.
    made = reached = graph.input[0].name
    between: _Linear | None = None
    # A node that does nothing ends the chain, and with it the last layer.
    for node in [*graph.node, onnx.NodeProto(op_type="Tanh", input=[graph.output[0].name])]:
        if list(node.input[:1]) != [reached]:
            return None
        if node.op_type == "Tanh":
            if between is not None:
                names = [f"{reached}.matrix", f"{reached}.offset"]
                tensors += map(onnx.numpy_helper.from_array, between, names)
                nodes.append(onnx.helper.make_node("Gemm", [made, *names], [reached], transB=1))
            nodes.append(node)
            between = None
        else:
            step = _linear(node, constants)
            between = step if between is None or step is None else _one(between, step)
            if between is None:
                return None
        reached = node.output[0] if node.output else ""
        made = made if between is not None else reached
    short = onnx.ModelProto()
    short.CopyFrom(model)
    del short.graph.node[:]
    del short.graph.initializer[:]
    del short.graph.value_info[:]
    short.graph.node.extend(nodes[:-1])
    short.graph.initializer.extend(tensors)
    return short


def _linear(node: onnx.NodeProto, constants: dict[str, FloatArray]) -> _Linear | None:
    """What a node does to rows, if that is linear."""
    values = [constants[name] for name in node.input[1:] if name in constants]
    dimensions = [value.ndim for value in values]
    if node.op_type == "Gemm" and dimensions == [2, 1]:
        given = {entry.name: onnx.helper.get_attribute_value(entry) for entry in node.attribute}
        fits = len(values[0]) == len(values[1])
        return _Linear(*values) if given == _LAYER and fits else None
    if node.op_type not in ("Add", "Sub", "Mul", "Div") or dimensions != [1]:
        return None
    row = values[0]
    if len(row) == 1:
        # It may be for numbers of any width.
        return None
    if node.op_type in ("Add", "Sub"):
        return _Linear(np.eye(len(row)), row if node.op_type == "Add" else -row)
    return _Linear(np.diag(row if node.op_type == "Mul" else 1.0 / row), np.zeros(len(row)))


def _one(first: _Linear, second: _Linear) -> _Linear | None:
    """What one does after the other; None if their widths differ."""
    if first.matrix.shape[0] != second.matrix.shape[1]:
        return None
    return _Linear(
        np.ascontiguousarray(second.matrix @ first.matrix),
        second.matrix @ first.offset + second.offset,
    )
