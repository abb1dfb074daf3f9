"""Checks of poses and the difference between them. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from annik_core.errors import NonFiniteValue, NotUnitQuaternion, WrongShape
from annik_core.pose import (
    POSE_FIELDS,
    FloatArray,
    checked_pose,
    pose_difference,
    pose_distance,
    pose_from_roll_pitch_yaw,
    quaternion_from_roll_pitch_yaw,
    roll_pitch_yaw,
    rotation_matrix,
    single_pose_difference,
    transformed,
)

angles = st.lists(st.floats(-np.pi, np.pi), min_size=3, max_size=3)
positions = st.lists(st.floats(-10, 10), min_size=3, max_size=3)
IDENTITY = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@given(positions, angles)
def test_a_unit_pose_comes_back_bit_for_bit(position: list[float], rpy: list[float]) -> None:
    """What needs no correction gets none."""
    once = checked_pose(pose_from_roll_pitch_yaw(position, rpy))
    assert np.array_equal(checked_pose(once), once)


@pytest.mark.parametrize("field", range(7))
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_named(field: int, value: float) -> None:
    """The error says which of the seven."""
    pose = np.array(IDENTITY)
    pose[field] = value
    with pytest.raises(NonFiniteValue) as caught:
        checked_pose(pose)
    assert caught.value.field == POSE_FIELDS[field]
    assert np.array_equal(caught.value.value, value, equal_nan=True)


@pytest.mark.parametrize("norm", [0.0, 1e-300, 0.9, 0.9989, 1.0011, 2.0, 1e200])
def test_a_quaternion_far_from_unit_norm_is_refused(norm: float) -> None:
    """The zero quaternion is one of them."""
    with pytest.raises(NotUnitQuaternion) as caught:
        checked_pose([0, 0, 0, norm, 0, 0, 0])
    assert caught.value.norm == norm


@given(st.floats(0.9991, 1.0009), angles)
def test_a_quaternion_near_unit_norm_is_normalised(scale: float, rpy: list[float]) -> None:
    """Within a thousandth, the direction counts."""
    pose = pose_from_roll_pitch_yaw([1, 2, 3], rpy)
    scaled = np.concatenate([pose[:3], scale * pose[3:]])
    assert checked_pose(scaled) == pytest.approx(pose, abs=1e-12)


@pytest.mark.parametrize("shape", [(6,), (8,), (1, 7), ()])
def test_wrong_shape(shape: tuple[int, ...]) -> None:
    """Seven numbers, no more, no less."""
    with pytest.raises(WrongShape) as caught:
        checked_pose(np.zeros(shape))
    assert caught.value.shape == shape
    assert "7" in caught.value.expected


@given(positions, angles)
def test_difference_of_a_pose_and_itself_is_zero(position: list[float], rpy: list[float]) -> None:
    """Also with the quaternion negated, which is the same orientation."""
    pose = pose_from_roll_pitch_yaw(position, rpy)
    negated = np.concatenate([pose[:3], -pose[3:]])
    for other in (pose, negated):
        position_error, rotation = pose_difference(pose, other)
        assert np.array_equal(position_error, np.zeros(3))
        assert np.linalg.norm(rotation) < 1e-7


@given(st.floats(-3.1, 3.1))
def test_difference_is_the_rotation_that_is_missing(angle: float) -> None:
    """A target turned about z by an angle is missed by that angle about z, in the base frame."""
    start = pose_from_roll_pitch_yaw([0, 0, 0], [0.4, 0.0, 0.0])
    target = pose_from_roll_pitch_yaw([0, 0, 0.5], [0.4, 0.0, angle])
    position, rotation = pose_difference(target, start)
    assert position == pytest.approx([0, 0, 0.5])
    assert rotation == pytest.approx([0, 0, angle], abs=1e-9)


def test_distance_is_the_norm_of_the_difference() -> None:
    """Of many poses at once, and of one."""
    start = pose_from_roll_pitch_yaw(np.zeros((2, 3)), [[0.4, 0.0, 0.0], [0.0, 0.0, 0.0]])
    target = pose_from_roll_pitch_yaw([[3, 0, 4], [0, 0, 0]], [[0.4, 0.0, -0.7], [0.0, 0.2, 0.0]])
    distances, angles = pose_distance(target, start)
    assert distances == pytest.approx([5.0, 0.0])
    assert angles == pytest.approx([0.7, 0.2])
    for row in range(2):
        assert pose_distance(target[row], start[row]) == (distances[row], angles[row])


# --- single poses, in Python's own numbers: SciPy is the oracle ------------------------------

_ANGLE = st.floats(-3.2, 3.2)


@given(_ANGLE, st.floats(-1.5, 1.5), _ANGLE)
def test_single_quaternions_and_angles_are_those_of_scipy(
    roll: float, pitch: float, yaw: float
) -> None:
    """There and back, off the singularity."""
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw])
    quaternion = quaternion_from_roll_pitch_yaw(roll, pitch, yaw)
    np.testing.assert_allclose(quaternion, expected.as_quat(canonical=True), rtol=0, atol=1e-15)
    found = roll_pitch_yaw(np.array(quaternion))
    turned = Rotation.from_euler("xyz", found) * expected.inv()
    assert turned.magnitude() < 1e-14
    np.testing.assert_allclose(np.cos(found), np.cos([roll, pitch, yaw]), rtol=0, atol=1e-13)


@given(
    arrays(np.float64, 3, elements=st.floats(-3.1, 3.1)),
    arrays(np.float64, 3, elements=st.floats(-1.8, 1.8)),
    st.integers(-12, 0),
    st.booleans(),
)
def test_the_difference_of_single_poses_is_that_of_many(
    start: FloatArray, turn: FloatArray, exponent: int, negative: bool
) -> None:
    """From nothing to half a turn, whichever of its two quaternions an orientation has."""
    achieved = Rotation.from_rotvec(start)
    target = Rotation.from_rotvec(10.0**exponent * turn) * achieved
    sign = -1.0 if negative else 1.0
    poses = [
        np.array([*start, *quaternion])
        for quaternion in (sign * target.as_quat(), achieved.as_quat())
    ]
    position, rotation = pose_difference(*poses)
    single_position, single_rotation = single_pose_difference(*poses)
    np.testing.assert_array_equal(single_position, position)
    np.testing.assert_allclose(single_rotation, rotation, rtol=0, atol=4e-15)


def test_the_difference_of_a_pose_to_itself_is_nothing() -> None:
    """Exactly."""
    pose = pose_from_roll_pitch_yaw([1, 2, 3], [0.1, 0.2, 0.3])
    assert single_pose_difference(pose, pose) == ([0.0] * 3, [0.0] * 3)


def test_transformed_poses_are_those_that_scipy_composes() -> None:
    """Of many poses, and of unchecked ones: what is not finite or no unit quaternion stays so."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        frame, *poses = (
            pose_from_roll_pitch_yaw(rng.normal(size=3), rng.uniform(-3, 3, 3)) for _ in range(6)
        )
        turn = Rotation.from_quat(frame[3:])
        for pose, found in zip(poses, transformed(frame, np.array(poses)), strict=True):
            np.testing.assert_allclose(found[:3], turn.apply(pose[:3]) + frame[:3], atol=1e-12)
            expected = turn * Rotation.from_quat(pose[3:])
            assert (expected.inv() * Rotation.from_quat(found[3:])).magnitude() < 1e-7
            np.testing.assert_allclose(
                expected.as_matrix(), rotation_matrix(found[3:]), atol=1e-12
            )
    assert transformed(frame, np.zeros((0, 7))).shape == (0, 7)
    strange = np.array([[np.nan, 0, 0, 0, 0, 0, 1], [0, np.inf, 0, 0, 0, 0, 1], [0] * 6 + [1.5]])
    found = transformed(frame, strange)
    assert not np.isfinite(found[:2, :3]).all(axis=1).any()
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:], axis=1), [1.0, 1.0, 1.5])
