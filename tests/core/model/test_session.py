"""One pose, with the encoding in plain floats, gives what the whole graph gives. ROS-free."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.installation import default_model_path, packaged_models
from annik_core.kernel import compiled_kernel
from annik_core.model.artifact import Model, load_model
from annik_core.model.graph import OPERATORS, LayerOfGraph, layers_of, nodes_after
from annik_core.pose import FloatArray, pose_from_roll_pitch_yaw

MODEL, ARM = load_model(default_model_path()), load_model("ur5e")
_COORDINATE = st.floats(0.2, 0.9)


def _whole(pose: FloatArray, model: Model = MODEL) -> FloatArray:
    joint_positions: FloatArray = model.session.run(None, {"pose": pose[np.newaxis]})[0][0]
    return joint_positions


@given(
    st.tuples(_COORDINATE, _COORDINATE, _COORDINATE),
    st.floats(-3.1, 3.1),
    st.floats(-np.pi / 2, np.pi / 2),
    st.floats(-3.1, 3.1),
    st.sampled_from([1.0, -1.0]),
)
def test_one_pose_has_the_joint_positions_of_the_whole_graph(
    position: tuple[float, ...], roll: float, pitch: float, yaw: float, sign: float
) -> None:
    """Also at the edge, where the whole graph is run, and for a negative quaternion."""
    pose = pose_from_roll_pitch_yaw(position, [roll, pitch, yaw])
    pose[3:] *= sign
    tolerance = 1e-11 / max(np.cos(pitch), 1e-3)
    np.testing.assert_allclose(
        MODEL.joint_positions_at(pose), _whole(pose), rtol=0, atol=tolerance
    )


def test_the_results_of_two_calls_are_two_arrays() -> None:
    """Though both pass through the same memory."""
    first, second = (
        MODEL.joint_positions_at(pose_from_roll_pitch_yaw([x, 0.4, 0.6], [0.5, 0.4, 0.3]))
        for x in (0.3, 0.4)
    )
    assert not np.shares_memory(first, second)
    assert first[0] != second[0]


def test_of_an_arm_too() -> None:
    for pose in ARM.robot.forward_kinematics.poses(
        ARM.robot.joint_box.sample(50, np.random.default_rng(5))
    ):
        for signed in (pose, pose * [1, 1, 1, -1, -1, -1, -1]):
            found = ARM.joint_positions_at(signed)
            np.testing.assert_allclose(found, _whole(signed, ARM), rtol=0, atol=1e-12)


def test_both_encodings_are_computed_in_plain_floats() -> None:
    for model in (MODEL, ARM):
        assert model.after_features is not None
    for model, encoding in (
        (MODEL, "position_roll_pitch_yaw"),
        (ARM, "position_rotation_matrix"),
    ):
        assert model.after_encoding(encoding) is model.after_features
        assert model.after_encoding("another") is None


@pytest.mark.skipif(compiled_kernel() is None, reason="the kernel is not there")
@pytest.mark.parametrize("name", packaged_models())
def test_a_start_of_the_kernel_is_what_onnxruntime_gives(name: str) -> None:
    model = load_model(name)
    assert model.encoding is not None
    box = model.robot.joint_box
    for pose in model.robot.forward_kinematics.poses(box.sample(50, np.random.default_rng(7))):
        features = model.encoding.features(pose)
        assert features is not None
        start = model.start_network.run(np.frombuffer(features))
        scale = 1 / max(np.cos(np.arcsin(np.clip(_sine_of_pitch(pose), -1, 1))), 1e-3)
        np.testing.assert_allclose(start, _whole(pose, model), rtol=0, atol=1e-12 * scale)


def _sine_of_pitch(pose: FloatArray) -> float:
    x, y, z, w = pose[3:]
    return float(2 * (w * y - z * x))


def _layers(*nodes: onnx.NodeProto) -> list[LayerOfGraph] | None:
    weights = {"w": np.arange(6.0).reshape(2, 3), "v": np.ones((2, 2)), "b": np.ones(2)}
    tensors = [onnx.numpy_helper.from_array(x, name) for name, x in weights.items()]
    graph = onnx.helper.make_graph(list(nodes), "g", [], [], tensors)
    path = default_model_path()
    return layers_of(list(nodes), "features", onnx.helper.make_model(graph), path)


def _node(kind: str, inputs: str, output: str, **attributes: float) -> onnx.NodeProto:
    return onnx.helper.make_node(kind, inputs.split(), [output], **attributes)


def test_layers_of_a_graph() -> None:
    """A second path from the features is added to the last layer, as the packaged models do."""
    layers = _layers(
        _node("Gemm", "features w b", "one", transB=1),
        _node("Tanh", "one", "bent"),
        _node("Gemm", "features w b", "other", transB=1),
        _node("Gemm", "bent v other", "joint_positions"),
    )
    assert layers is not None
    assert [(x.source, x.addend, x.bends) for x in layers] == [
        (0, None, True),
        (0, None, False),
        (1, 2, False),
    ]
    assert layers[2].bias.tolist() == [0, 0]
    assert np.array_equal(layers[0].weights, np.arange(6.0).reshape(2, 3))


@pytest.mark.parametrize(
    "nodes",
    [
        [_node("Gemm", "features w b", "y", transB=1, alpha=2.0)],
        [_node("Gemm", "features w b", "y", transB=1, beta=0.5)],
        [_node("Gemm", "features w", "y", transB=1)],
        [_node("Gemm", "features w b", "y")],  # 3 inputs, but 2 of them in the weights
        [_node("Relu", "features", "y")],
        [_node("Tanh", "features", "y")],
        [_node("Gemm", "features w b", "x", transB=1), _node("MatMul", "x v", "y")],
        [
            _node("Gemm", "features w b", "x", transB=1),
            _node("Tanh", "x", "z"),
            _node("Gemm", "z v x", "y"),  # x is needed before tanh too
        ],
    ],
)
def test_what_is_no_chain_of_layers_stays_with_onnxruntime(nodes: list[onnx.NodeProto]) -> None:
    assert _layers(*nodes) is None


@pytest.mark.parametrize(
    ("name", "operators"),
    [
        ("gantry", "Gemm Tanh Gemm"),
        ("ur5e", "Gemm Tanh Gemm Tanh Gemm Gemm"),
    ],
)
def test_after_the_features_there_are_layers_only(name: str, operators: str) -> None:
    """A scaling would take onnxruntime as long as a layer."""
    path = default_model_path().with_name(f"{name}.onnx")
    graph = onnx.load(path)
    nodes = nodes_after("features", graph, path)
    assert " ".join(node.op_type for node in nodes) == operators
    assert {node.op_type for node in graph.graph.node} <= OPERATORS
