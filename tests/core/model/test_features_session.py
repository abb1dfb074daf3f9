"""The part of a graph behind its features answers as the whole does. Needs no ROS."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.model.artifact import (
    REFERENCE_TOLERANCE,
    default_model_path,
    load_model,
    make_session,
)
from annik_core.model.session import BoundSession, session_from_features
from annik_core.pose import FloatArray, pose_from_roll_pitch_yaw

ARTIFACT = load_model(default_model_path())
_COORDINATE = st.floats(0.2, 0.9)


def _whole(pose: FloatArray) -> FloatArray:
    answer: FloatArray = ARTIFACT.session.run(None, {"pose": pose[np.newaxis]})[0][0]
    return answer


@given(
    st.tuples(_COORDINATE, _COORDINATE, _COORDINATE),
    st.floats(-3.1, 3.1),
    st.floats(-np.pi / 2, np.pi / 2),
    st.floats(-3.1, 3.1),
    st.sampled_from([1.0, -1.0]),
)
def test_one_pose_has_the_answer_of_the_whole_graph(
    position: tuple[float, ...], roll: float, pitch: float, yaw: float, sign: float
) -> None:
    """Also at the edge, where the whole graph is run, and for a negative quaternion."""
    pose = pose_from_roll_pitch_yaw(position, [roll, pitch, yaw])
    pose[3:] *= sign
    tolerance = 1e-11 / max(np.cos(pitch), 1e-3)
    np.testing.assert_allclose(
        ARTIFACT.joint_positions_at(pose), _whole(pose), rtol=0, atol=tolerance
    )


def test_the_gantrys_graph_is_cut_and_an_arms_is_not() -> None:
    """The arm's encoding is short."""
    assert isinstance(ARTIFACT.from_features, BoundSession)
    pytest.importorskip("pinocchio")
    assert load_model("ur5e").from_features is None


def test_a_graph_that_computes_something_else_is_run_whole() -> None:
    """What is not proven by the reference answers is not used."""
    model = onnx.load(default_model_path())
    poses = np.array(ARTIFACT.metadata.reference_poses)
    wrong = np.array(ARTIFACT.metadata.reference_joint_positions) + 1e-6

    def cut(expected: FloatArray) -> BoundSession | None:
        return session_from_features(
            model,
            poses,
            expected,
            REFERENCE_TOLERANCE,
            lambda rest: make_session(rest, default_model_path()),
        )

    assert cut(wrong) is None
    assert cut(wrong - 1e-6) is not None
