"""The graph of a model file: its names, what it may hold, and the part after the encoding.

The checks go by what is in the file, not by what it says of itself. They bound time and memory
before onnxruntime sees the graph, which computes constants while it loads.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from google.protobuf import descriptor_pb2, message_factory
from numpy.typing import NDArray

from annik_core.model.errors import InvalidGraph, InvalidMetadata, UnreadableModel
from annik_core.pose import FloatArray

INPUT_NAME = "pose"
OUTPUT_NAME = "joint_positions"
#: The tensor in which the encoding of the pose ends, as annik writes it.
FEATURES_NAME = "features"

#: Operators of ONNX's own domain that a graph may use. With these it has no weights that the
#: checks do not see, no randomness, and no memory from call to call. A new encoding may add to
#: them, if that stays true and :func:`_shape` knows the size of its result.
# fmt: off
OPERATORS = frozenset({
    # Those of the packaged models.
    "Abs", "Add", "Atan", "Cast", "Concat", "Cos", "Div", "Gemm", "Less", "MatMul", "Max", "Mul",
    "Round", "Sin", "Slice", "Sqrt", "Sub", "Tanh", "Where",
    # The same, as another version of torch's exporter may write it.
    "Constant", "Identity",
    # Plain arithmetic, for other encodings and activations.
    "Acos", "And", "Asin", "Ceil", "Clip", "Equal", "Exp", "Floor", "Greater", "GreaterOrEqual",
    "LessOrEqual", "Log", "Min", "Neg", "Not", "Or", "Pow", "Reciprocal", "Relu", "Sigmoid",
    "Sign", "Tan",
})
# fmt: on

#: Most operators of a graph, most numbers that one pose needs in all of them, and most products
#: of matrix elements. The gantry's has 61, 300 and 240; a million products take 1 ms.
MAX_PARTS, MAX_NUMBERS, MAX_PRODUCTS = 1000, 100_000, 8_000_000
# The number of poses in shapes: no other dimension is as large.
_POSES = 10**9
_DOMAINS = ("", "ai.onnx")
_DOUBLE = 11
#: Types of tensors by their number in ONNX.
_TENSOR_TYPES = {_DOUBLE: "<f8", 1: "<f4", 7: "<i8", 6: "<i4", 9: "?"}
_VALUE_FIELDS = {"name", "type", "f", "i", "s", "t", "floats", "ints"}

#: The fields of ONNX's messages that a model has, or that are refused by name: name, number and
#: type; * if repeated. All others have no effect, since onnxruntime gets only these.
_MESSAGES = {
    "Entry": "key 1 string, value 2 string",
    "Dimension": "dim_value 1 int64, dim_param 2 string",
    "Shape": "dim 1 Dimension*",
    "TensorType": "elem_type 1 int32, shape 2 Shape",
    "Type": "tensor_type 1 TensorType",
    "Value": "name 1 string, type 2 Type",
    "Tensor": "dims 1 int64*, data_type 2 int32, name 8 string, raw_data 9 bytes, "
    "data_location 14 int32",
    "Attribute": "name 1 string, f 2 float, i 3 int64, s 4 bytes, t 5 Tensor, g 6 bytes, "
    "floats 7 float*, ints 8 int64*, strings 9 bytes*, tensors 10 bytes*, graphs 11 bytes*, "
    "tp 14 bytes, type_protos 15 bytes*, type 20 int32, ref_attr_name 21 bytes, "
    "sparse_tensor 22 bytes, sparse_tensors 23 bytes*",
    "Node": "input 1 string*, output 2 string*, name 3 string, op_type 4 string, "
    "attribute 5 Attribute*, domain 7 string",
    "Graph": "node 1 Node*, name 2 string, initializer 5 Tensor*, input 11 Value*, "
    "output 12 Value*, sparse_initializer 15 bytes*",
    "Opset": "domain 1 string, version 2 int64",
    "Model": "ir_version 1 int64, graph 7 Graph, opset_import 8 Opset*, metadata_props 14 Entry*, "
    "functions 25 bytes*",
}


def _model_class() -> Any:
    """The class of model files, as the library onnx has it; onnxruntime needs protobuf anyway."""
    file = descriptor_pb2.FileDescriptorProto(name="annik.proto", package="annik")
    for message, fields in _MESSAGES.items():
        described = file.message_type.add(name=message)
        for name, number, kind in (field.split() for field in fields.split(", ")):
            field = described.field.add(name=name, number=int(number))
            field.label = field.LABEL_REPEATED if kind.endswith("*") else field.LABEL_OPTIONAL
            kind = kind.rstrip("*")
            if kind in _MESSAGES:
                field.type, field.type_name = field.TYPE_MESSAGE, f".annik.{kind}"
            else:
                field.type = getattr(field, f"TYPE_{kind.upper()}")
    return message_factory.GetMessages([file])["annik.Model"]


_Model = _model_class()


def parsed_graph(content: bytes, path: Path) -> Any:
    """Parse the bytes of a model file; raise UnreadableModel if not ONNX, or truncated."""
    try:
        model = _Model.FromString(content)
    # The protobuf library's DecodeError has moved between its versions.
    except Exception as error:
        raise UnreadableModel(path, "not an ONNX file, or truncated") from error
    if not model.graph.node:
        raise UnreadableModel(path, "not an ONNX file, or truncated: it has no graph")
    model.DiscardUnknownFields()
    return model


def check_graph(model: Any, path: Path) -> None:
    """Raise InvalidGraph for what other checks can't see into, numbers not finite, or too many."""
    for part, found in (
        ("functions", model.functions),
        ("sparse_initializer", model.graph.sparse_initializer),
    ):
        if found:
            raise InvalidGraph(path, part, "is a part that no model has")
    nodes, tensors = model.graph.node, model.graph.initializer
    lists = [nodes, tensors, model.graph.input, model.metadata_props, model.opset_import]
    lists += [part for node in nodes for part in (node.input, node.attribute)]
    if max(map(len, lists)) > MAX_PARTS:
        problem = f"has a list of more than {MAX_PARTS}: operators, tensors, inputs or entries"
        raise InvalidGraph(path, "graph", problem)
    constants: dict[str, NDArray[Any]] = {}
    for tensor in tensors:
        if tensor.name == INPUT_NAME or tensor.name in constants:
            raise InvalidGraph(path, tensor.name, "is there twice")
        constants[tensor.name] = tensor_values(tensor, path)
    shapes: dict[str, tuple[int, ...]] = {name: x.shape for name, x in constants.items()}
    shapes[INPUT_NAME] = (_POSES, 7)
    numbers = products = 0
    for node in nodes:
        if node.domain not in _DOMAINS or node.op_type not in OPERATORS:
            operator = f"{node.domain}.{node.op_type}" if node.domain else node.op_type
            raise InvalidGraph(path, operator, "is not an operator that a model uses")
        for attribute in node.attribute:
            _check_attribute(attribute, path)
        if len(node.output) != 1 or node.output[0] in shapes:
            raise InvalidGraph(path, node.op_type, "has not one output of its own")
        output = node.output[0]
        if node.op_type == "Constant" and [x.name for x in node.attribute] == ["value"]:
            constants[output] = tensor_values(node.attribute[0].t, path)
        try:
            shapes[output], count = _shape(node, shapes, constants)
        # KeyError: an input or a constant is missing.
        except (ValueError, IndexError, KeyError, TypeError) as error:
            raise InvalidGraph(path, output, f"has no known shape ({error!r})") from error
        numbers += math.prod(shapes[output]) // (_POSES if _POSES in shapes[output] else 1)
        products += count
        if numbers > MAX_NUMBERS or products > MAX_PRODUCTS:
            problem = f"takes more than {MAX_NUMBERS} numbers or {MAX_PRODUCTS} products a pose"
            raise InvalidGraph(path, output, problem)


def _shape(
    node: Any, shapes: Mapping[str, tuple[int, ...]], constants: Mapping[str, NDArray[Any]]
) -> tuple[tuple[int, ...], int]:
    """The shape of a node's output, and its products of matrix elements for a pose."""
    if node.op_type == "Constant":
        return constants[node.output[0]].shape, 0
    inputs = [shapes[name] for name in node.input if name]
    attributes = {attribute.name: attribute.i for attribute in node.attribute}
    if node.op_type == "Concat":
        heights, widths = zip(*inputs, strict=True)
        if attributes["axis"] not in (1, -1) or len(set(heights)) != 1:
            raise ValueError("parts of different height")
        return (heights[0], sum(widths)), 0
    if node.op_type == "Slice":
        height, width = inputs[0]
        start, end, axis, *step = (constants[name].item() for name in node.input[1:])
        if axis not in (1, -1):
            raise ValueError("a part of the poses")
        return (height, len(range(width)[slice(start, end, *step)])), 0
    if node.op_type in ("MatMul", "Gemm"):
        (height, inner), (lower, columns) = inputs[:2]
        if attributes.get("transB"):
            lower, columns = columns, lower
        # Weights only: a product of two tensors of n rows would have n times as many numbers.
        if inner != lower or _POSES in (lower, columns) or attributes.get("transA"):
            raise ValueError("a product of matrices that do not fit")
        shape = np.broadcast_shapes((height, columns), *inputs[2:])
        return shape, inner * columns * (1 if height == _POSES else height)
    return np.broadcast_shapes(*inputs), 0


def graph_properties(model: Any, path: Path) -> dict[str, str]:
    """The metadata properties of a file; raise InvalidMetadata if two have one name."""
    properties: dict[str, str] = {}
    for entry in model.metadata_props:
        if entry.key in properties:
            # Which of them counts would depend on the reader.
            raise InvalidMetadata(path, entry.key.removeprefix("annik."), "there more than once")
        properties[entry.key] = entry.value
    return properties


def nodes_after(features: str, model: Any, path: Path) -> list[Any]:
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


def graph_of(nodes: list[Any], features: str, model: Any) -> Any:
    """A graph of :func:`nodes_after` one tensor, which is its input ``(n, m)``."""
    part = _Model(ir_version=model.ir_version, opset_import=model.opset_import)
    used = {name for node in nodes for name in node.input}
    part.graph.name = features
    part.graph.node.extend(nodes)
    part.graph.initializer.extend(t for t in model.graph.initializer if t.name in used)
    tensor_type = part.graph.input.add(name=features).type.tensor_type
    tensor_type.elem_type = _DOUBLE
    for name in ("n", "m"):
        tensor_type.shape.dim.add(dim_param=name)
    part.graph.output.extend(model.graph.output)
    return part


class LayerOfGraph(NamedTuple):
    """One layer of a feedforward network: ``weights @ source + bias + addend``, then perhaps tanh.

    Attributes:
        source, addend: 0 for the network's input, 1 for the first layer's output, and so on.
        weights: ``(outputs, inputs)``.
        bias: ``(outputs,)``, zero where there is none.
    """

    source: int
    addend: int | None
    weights: FloatArray
    bias: FloatArray
    bends: bool


def layers_of(
    nodes: list[Any], features: str, model: Any, path: Path
) -> list[LayerOfGraph] | None:
    """The nodes of :func:`nodes_after` as layers of one pose; None if they are something else."""
    constants = {x.name: tensor_values(x, path) for x in model.graph.initializer}
    vectors = {features: 0}
    layers: list[LayerOfGraph] = []
    for node in nodes:
        attributes = {x.name: x.f or x.i for x in node.attribute}
        if node.op_type == "Tanh" and vectors.get(node.input[0]) == len(layers) > 0:
            # The layer's output before tanh is then no vector any more.
            del vectors[node.input[0]]
            layers[-1] = layers[-1]._replace(bends=True)
        elif node.op_type == "Gemm" and len(node.input) == 3:
            source, weights, added = node.input
            scaled = attributes.get("alpha", 1.0) != 1.0 or attributes.get("beta", 1.0) != 1.0
            if scaled or source not in vectors or weights not in constants:
                return None
            matrix = constants[weights] if attributes.get("transB") else constants[weights].T
            bias = constants.get(added, np.zeros(len(matrix)))
            if added not in {**constants, **vectors} or bias.shape != (len(matrix),):
                return None
            layers.append(LayerOfGraph(vectors[source], vectors.get(added), matrix, bias, False))
        else:
            return None
        vectors[node.output[0]] = len(layers)
    return layers


def _check_attribute(attribute: Any, path: Path) -> None:
    # By the fields, not by the type that the attribute claims to have.
    if not {field.name for field, _ in attribute.ListFields()} <= _VALUE_FIELDS:
        raise InvalidGraph(path, attribute.name, "is an attribute that is not numbers or text")
    if attribute.HasField("t"):
        tensor_values(attribute.t, path)
    if not np.isfinite([attribute.f, *attribute.floats]).all():
        raise InvalidGraph(path, attribute.name, "holds a number that is not finite")


def tensor_values(tensor: Any, path: Path) -> NDArray[Any]:
    """The finite numbers of a tensor; raise InvalidGraph if it has others, or is damaged."""
    if tensor.data_location:
        raise InvalidGraph(path, tensor.name, "is a tensor stored outside the file")
    if tensor.data_type not in _TENSOR_TYPES:
        problem = f"is a tensor of type {tensor.data_type}, which no model uses"
        raise InvalidGraph(path, tensor.name, problem)
    try:
        values = np.frombuffer(tensor.raw_data, dtype=_TENSOR_TYPES[tensor.data_type])
        values = values.reshape(tuple(tensor.dims))
    except (ValueError, TypeError) as error:
        raise InvalidGraph(path, tensor.name, "is a damaged tensor") from error
    if not np.isfinite(values).all():
        raise InvalidGraph(path, tensor.name, "holds a number that is not finite")
    return values
