"""An onnxruntime session that is bound to one pose.

Make one layer of neighbours that are linear: a scaling costs onnxruntime as much as a layer.

Run a network from its features on: for one pose, the encoding in the graph is most of the time.

A model file holds everything from the pose to the joint positions. The first part of the gantry's
graph turns a quaternion into roll, pitch and yaw, in some fifty operations on single numbers, each
of which costs onnxruntime as much as a whole layer. Where the angles are at hand, the rest of the
graph alone gives the same answer. Which part that is, is found by trying, and proven by the
reference answers in the file; a graph without such a part is run whole. What is left is scalings
and layers; fewer of them do the same, see :mod:`annik_core.model.session`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import onnx
import onnxruntime

from annik_core.pose import FloatArray, roll_pitch_yaw

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


#: The pose encoding whose features these are, by its name in a model file.
ENCODING = "position_roll_pitch_yaw"
#: Nearer to 90 degrees, the graph's own encoding is the more careful one [rad].
_ACCURATE_PITCH = 0.5 * np.pi - 1e-3

MakeSession = Callable[[bytes], onnxruntime.InferenceSession]


class BoundSession:
    """A session bound to memory for one row of numbers and its answer.

    Not for several threads at once: both pass through memory of this object.
    """

    def __init__(
        self, session: onnxruntime.InferenceSession, names: tuple[str, str], sizes: tuple[int, int]
    ) -> None:
        """Bind.

        Args:
            session: what is run.
            names: of its input and its output.
            sizes: how many numbers a row of each has.
        """
        self._session = session
        self._input, self._output = (np.zeros((1, size)) for size in sizes)
        self._input_row, self._output_row = self._input[0], self._output[0]
        self._binding: Any = session.io_binding()
        # On a processor an OrtValue is the array's own memory.
        self._binding.bind_ortvalue_input(
            names[0], onnxruntime.OrtValue.ortvalue_from_numpy(self._input)
        )
        self._binding.bind_ortvalue_output(
            names[1], onnxruntime.OrtValue.ortvalue_from_numpy(self._output)
        )

    def __call__(self, row: FloatArray | list[float]) -> FloatArray:
        """The answer ``(m,)`` to a row ``(n,)``."""
        self._input_row[:] = row
        self._session.run_with_iobinding(self._binding)
        answer: FloatArray = self._output_row.copy()
        return answer


def pose_features(
    pose: FloatArray, angles: tuple[float, float, float] | None = None
) -> list[float] | None:
    """x, y, z [m], roll, pitch, yaw [rad] of a pose ``(7,)``; None where the graph is to say.

    Args:
        pose: a checked pose.
        angles: its :func:`roll_pitch_yaw` [rad], if they are at hand.
    """
    x, y, z, *quaternion = pose.tolist()
    roll, pitch, yaw = angles or roll_pitch_yaw(quaternion)
    if not abs(pitch) < _ACCURATE_PITCH:
        return None
    return [x, y, z, roll, pitch, yaw]


def session_from_features(
    model: onnx.ModelProto,
    poses: FloatArray,
    expected: FloatArray,
    tolerance: float,
    make_session: MakeSession,
) -> BoundSession | None:
    """A session of the rest of a graph behind its features, or None if it has no such part.

    Args:
        model: the checked graph.
        poses: ``(n, 7)`` to prove it on.
        expected: ``(n, dof)`` the whole graph's answers to them.
        tolerance: how far an answer may be from that.
        make_session: makes a session of a serialized graph.

    Raises:
        ArtifactNotReadable: as ``make_session`` does.
    """
    features = [row for row in map(pose_features, poses) if row is not None]
    if len(features) < len(poses):
        return None
    output = model.graph.output[0].name
    for name, rest in _candidates(model):
        bound = BoundSession(
            make_session(rest.SerializeToString()),
            (name, output),
            (len(features[0]), expected.shape[1]),
        )
        try:
            answers = np.array([bound(row) for row in features])
        # A cut of another width; onnxruntime's exceptions have no common base but Exception.
        except Exception:
            continue
        if float(np.abs(answers - expected).max()) <= tolerance:
            return bound
    return None


def _candidates(model: onnx.ModelProto) -> Iterator[tuple[str, onnx.ModelProto]]:
    """The rests of a graph, each in its shorter form first, and the names of their inputs."""
    for name, rest in _rests(model):
        shorter = with_linear_layers(rest)
        if shorter is not None:
            yield name, shorter
        yield name, rest


def _rests(model: onnx.ModelProto) -> Iterator[tuple[str, onnx.ModelProto]]:
    """The graph from each tensor on that all that follows comes from alone, and its name."""
    nodes = model.graph.node
    constants = {tensor.name for tensor in model.graph.initializer}
    # What each node and those behind it need from before.
    needed: set[str] = {model.graph.output[0].name}
    cuts = []
    for index in range(len(nodes) - 1, -1, -1):
        if len(needed) == 1 and index < len(nodes) - 1:
            cuts.append((index + 1, next(iter(needed))))
        needed -= set(nodes[index].output)
        needed |= {name for name in nodes[index].input if name and name not in constants}
    for index, name in reversed(cuts):
        rest = onnx.ModelProto()
        rest.CopyFrom(model)
        del rest.graph.node[:index]
        del rest.graph.input[:]
        del rest.graph.value_info[:]
        rest.graph.input.append(
            onnx.helper.make_tensor_value_info(name, onnx.TensorProto.DOUBLE, ["n", None])
        )
        yield name, rest
