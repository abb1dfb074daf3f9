"""One pose, with the encoding in plain floats, gives what the whole graph gives. ROS-free."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.installation import default_model_path
from annik_core.model.artifact import Model, load_model
from annik_core.model.graph import OPERATORS, nodes_after
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
    assert (MODEL.after_products, ARM.after_products) == (None, ARM.after_features)


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
