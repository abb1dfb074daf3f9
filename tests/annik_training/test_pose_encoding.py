"""The encoding of a pose: exact, sign-free, defined on the gimbal edge. ROS-free."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from annik_core.pose import pose_from_roll_pitch_yaw
from annik_training.fitting.pose_encoding import PositionRollPitchYaw, arctangent2

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
    """The difference is kept, so the orientation is; the answer is the same for all such poses."""
    features = encode(pose_from_roll_pitch_yaw([0, 0, 0], [roll, HALF_PI, yaw]))
    assert features[4] == pytest.approx(HALF_PI, abs=1e-8)
    assert features[5] - features[3] == pytest.approx(yaw - roll, abs=1e-9)
    assert features[5] + features[3] == pytest.approx(HALF_PI, abs=1e-9)


def test_a_tenth_of_a_microradian_off_the_edge_tells_roll_from_yaw() -> None:
    """As close as the solver goes."""
    features = encode(pose_from_roll_pitch_yaw([0, 0, 0], [0.3, HALF_PI - 1e-7, 1.1]))
    assert features[3:] == pytest.approx([0.3, HALF_PI - 1e-7, 1.1], abs=1e-7)
