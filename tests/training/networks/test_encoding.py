"""The encodings of a pose: exact, sign-free, defined on the gimbal edge. ROS-free."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from annik_core.model.graph import OPERATORS
from annik_core.model.session import make_session
from annik_core.pose import pose_from_roll_pitch_yaw
from annik_training.networks.encoding import (
    PositionRollPitchYaw,
    PositionRotationMatrix,
    arctangent2,
)
from annik_training.networks.network import InverseKinematicsNetwork, ScaledNetwork, Scaling

CENTRE = np.radians([45.0, 45.0, 45.0])
HALF_PI = math.pi / 2


def encode(pose: np.ndarray) -> np.ndarray:
    encoding = PositionRollPitchYaw(CENTRE)
    return encoding(torch.from_numpy(np.atleast_2d(pose))).numpy()[0]


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_arctangent_is_that_of_the_standard_library(sine: float, cosine: float) -> None:
    """In double precision, though onnxruntime has a single-precision one only."""
    answer = arctangent2(
        torch.tensor([sine], dtype=torch.float64), torch.tensor([cosine], dtype=torch.float64)
    )
    expected = math.atan2(sine, cosine)
    # Squares below the smallest normal number lose digits; poses have none there.
    if math.hypot(sine, cosine) > 1e-140:
        difference = math.remainder(float(answer[0]) - expected, 2 * math.pi)
        assert abs(difference) < 1e-15
    assert math.isfinite(float(answer[0]))


@given(
    st.floats(-math.pi + 1e-6, math.pi - 1e-6),
    st.floats(-HALF_PI + 1e-3, HALF_PI - 1e-3),
    st.floats(-math.pi + 1e-6, math.pi - 1e-6),
)
def test_roll_pitch_yaw_come_back(roll: float, pitch: float, yaw: float) -> None:
    pose = pose_from_roll_pitch_yaw([0.1, 0.2, 0.3], [roll, pitch, yaw])
    assert encode(pose) == pytest.approx([0.1, 0.2, 0.3, roll, pitch, yaw], abs=1e-11)


@given(st.floats(0, HALF_PI), st.floats(0, HALF_PI), st.floats(0, HALF_PI))
def test_a_quaternion_and_its_negative_encode_alike(roll: float, pitch: float, yaw: float) -> None:
    pose = pose_from_roll_pitch_yaw([0.1, 0.2, 0.3], [roll, pitch, yaw])
    negated = np.concatenate([pose[:3], -pose[3:]])
    assert encode(negated) == pytest.approx(encode(pose), abs=1e-12)


@given(st.floats(0, HALF_PI), st.floats(0, HALF_PI))
def test_on_the_gimbal_edge_the_sum_is_that_of_the_centre(roll: float, yaw: float) -> None:
    """The difference is kept, and so the orientation; all such poses have the same features."""
    features = encode(pose_from_roll_pitch_yaw([0, 0, 0], [roll, HALF_PI, yaw]))
    assert features[4] == pytest.approx(HALF_PI, abs=1e-8)
    assert features[5] - features[3] == pytest.approx(yaw - roll, abs=1e-9)
    assert features[5] + features[3] == pytest.approx(HALF_PI, abs=1e-9)


def test_a_tenth_of_a_microradian_off_the_edge_tells_roll_from_yaw() -> None:
    """As close as the solver goes."""
    features = encode(pose_from_roll_pitch_yaw([0, 0, 0], [0.3, HALF_PI - 1e-7, 1.1]))
    assert features[3:] == pytest.approx([0.3, HALF_PI - 1e-7, 1.1], abs=1e-7)


def random_poses(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    quaternions = Rotation.random(count, random_state=0).as_quat()
    return np.concatenate([rng.uniform(-2.0, 2.0, (count, 3)), quaternions], axis=1)


def matrix_features(poses: np.ndarray) -> np.ndarray:
    return PositionRotationMatrix()(torch.from_numpy(poses)).numpy()


#: Half a turn about each axis and none: where other encodings have their edges.
EDGES = np.concatenate([np.zeros((4, 3)), np.eye(4)], axis=1)


def test_the_rotation_matrix_is_that_of_scipy_column_by_column() -> None:
    poses = np.concatenate([random_poses(500), EDGES])
    features = matrix_features(poses)
    assert features.shape == (504, PositionRotationMatrix.features)
    assert np.array_equal(features[:, :3], poses[:, :3])
    columns = Rotation.from_quat(poses[:, 3:]).as_matrix().transpose(0, 2, 1).reshape(-1, 9)
    assert features[:, 3:] == pytest.approx(columns, abs=1e-15, rel=0)


def test_the_rotation_matrix_of_a_quaternion_and_of_its_negative_are_the_same() -> None:
    """To the last bit: a product of two numbers is that of their negatives."""
    poses = np.concatenate([random_poses(100), EDGES])
    negated = np.concatenate([poses[:, :3], -poses[:, 3:]], axis=1)
    assert np.array_equal(matrix_features(negated), matrix_features(poses))


def test_the_rotation_matrix_is_smooth_everywhere() -> None:
    """It turns with the pose, each axis by the cross product, at the edges of others too."""
    poses = np.concatenate([random_poses(50), EDGES])
    step = 1e-5
    for axis in np.eye(3):
        there, back = (
            np.concatenate(
                [
                    poses[:, :3],
                    (
                        Rotation.from_rotvec(turn * axis) * Rotation.from_quat(poses[:, 3:])
                    ).as_quat(),
                ],
                axis=1,
            )
            for turn in (step, -step)
        )
        derivatives = (matrix_features(there) - matrix_features(back)) / (2.0 * step)
        columns = matrix_features(poses)[:, 3:].reshape(-1, 3, 3)
        expected = np.cross(axis, columns).reshape(-1, 9)
        assert derivatives[:, 3:] == pytest.approx(expected, abs=1e-9, rel=0)


def test_the_exported_rotation_matrix_is_the_same_and_its_graph_is_one_that_nodes_take() -> None:
    """Behind it a network that lets the features through: what comes out is their sums."""
    encoding = PositionRotationMatrix()
    box = Scaling(-np.ones(encoding.features), np.ones(encoding.features))
    network = ScaledNetwork((1,), box, box, linear_path=True)
    assert network.linear_path is not None
    with torch.no_grad():
        for parameter in network.output.parameters():
            parameter.zero_()
        network.linear_path.weight.copy_(torch.eye(encoding.features))
    model = InverseKinematicsNetwork(encoding, network).as_onnx()
    assert {node.op_type for node in model.graph.node} <= OPERATORS
    session = make_session(model.SerializeToString(), Path("encoding.onnx"))
    poses = np.concatenate([random_poses(200), EDGES])
    (answers,) = session.run(None, {"pose": poses})
    assert answers == pytest.approx(matrix_features(poses), abs=1e-12, rel=0)
    (negated,) = session.run(None, {"pose": poses * [1, 1, 1, -1, -1, -1, -1]})
    assert np.array_equal(negated, answers)
