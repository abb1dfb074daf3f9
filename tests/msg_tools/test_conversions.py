"""Messages to arrays and back. Needs the message packages, but no node."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("geometry_msgs")

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from sensor_msgs.msg import JointState

from annik_core.errors import (
    MalformedJointState,
    MissingJoint,
    NonFiniteValue,
    NotUnitQuaternion,
    WrongShape,
)
from annik_core.pose import POSE_FIELDS, checked_pose, pose_from_roll_pitch_yaw
from msg_tools.conversions.joint_state import (
    joint_state_from_array,
    joint_state_to_array,
    joint_trajectory_from_array,
    position_command_from_array,
)
from msg_tools.conversions.pose import (
    pose_from_array,
    pose_stamped_from_array,
    pose_to_array,
    vector3_from_array,
    vector3_stamped_from_array,
    vector3_to_array,
)
from msg_tools.conversions.stamp import InvalidStamp, stamp_from_nanoseconds, stamp_to_nanoseconds

JOINTS = ("shoulder", "elbow", "wrist")
STAMP = Time(sec=12, nanosec=34)

finite = st.floats(-1e9, 1e9)
angles = st.floats(-math.pi, math.pi)


def _joint_state(names: list[str], positions: list[float]) -> JointState:
    return JointState(name=names, position=positions)


@given(st.tuples(finite, finite, finite), st.tuples(angles, angles, angles))
def test_a_pose_survives_the_round_trip_bit_for_bit(
    position: tuple[float, ...], roll_pitch_yaw: tuple[float, ...]
) -> None:
    """A unit quaternion is not normalised once more."""
    pose = pose_from_roll_pitch_yaw(position, roll_pitch_yaw)
    np.testing.assert_array_equal(pose_to_array(pose_from_array(pose)), pose)
    checked = checked_pose(pose_to_array(pose_from_array(pose)))
    np.testing.assert_allclose(checked, pose, rtol=1e-15)


def test_the_fields_of_a_pose_are_not_mixed_up() -> None:
    """x, y, z, then the quaternion x, y, z, w."""
    message = pose_from_array([1, 2, 3, 0.5, -0.5, 0.5, 0.5])
    assert (message.position.x, message.position.y, message.position.z) == (1.0, 2.0, 3.0)
    assert message.orientation.y == -0.5
    assert message.orientation.w == 0.5


def test_a_default_pose_message_is_the_identity() -> None:
    """ROS sets w to 1."""
    np.testing.assert_array_equal(pose_to_array(Pose()), [0, 0, 0, 0, 0, 0, 1])


@pytest.mark.parametrize("index", range(7))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_pose_that_is_not_finite_is_refused_by_field(index: int, value: float) -> None:
    """By the check, which names the field; the conversion passes the number on."""
    pose = np.array([0.1, 0.2, 0.3, 0, 0, 0, 1])
    pose[index] = value
    message = pose_from_array(pose)
    with pytest.raises(NonFiniteValue) as caught:
        checked_pose(pose_to_array(message))
    assert POSE_FIELDS[index] in caught.value.field
    np.testing.assert_array_equal(pose_to_array(message), pose)


@pytest.mark.parametrize("norm", [0.0, 0.9, 1.1, 1e200])
def test_a_quaternion_that_is_no_rotation_is_refused(norm: float) -> None:
    """Zero, too short, too long, and so long that its square overflows."""
    with pytest.raises(NotUnitQuaternion):
        checked_pose(pose_to_array(pose_from_array([0, 0, 0, 0, 0, 0, norm])))


def test_a_quaternion_that_is_nearly_one_is_normalised() -> None:
    """Within the tolerance of the pose."""
    pose = checked_pose(pose_to_array(pose_from_array([0, 0, 0, 0, 0, 0, 1.0005])))
    assert pose[6] == 1.0


@pytest.mark.parametrize("number", [np.float32(3), np.float64(3), np.int64(3), 3])
def test_any_number_type_becomes_a_float(number: object) -> None:
    """A field of another type would be written as garbage."""
    message = pose_from_array([number, 0, 0, 0, 0, 0, 1])
    assert type(message.position.x) is float
    assert message.position.x == 3.0
    assert type(vector3_from_array([number, number, number]).z) is float
    assert type(joint_state_from_array([number], ["a"], STAMP).position[0]) is float


def test_wrong_shapes_are_refused() -> None:
    """Each error names the array and its shape."""
    for convert, what, shape in (
        (pose_from_array, "pose", (6,)),
        (vector3_from_array, "vector", (1, 3)),
        (lambda array: joint_state_from_array(array, JOINTS), "joint positions", (2,)),
    ):
        with pytest.raises(WrongShape) as caught:
            convert(np.zeros(shape))
        assert (caught.value.what, caught.value.shape) == (what, shape)


def test_stamped_messages_carry_stamp_and_frame() -> None:
    """As given."""
    pose = pose_stamped_from_array([0, 0, 0, 0, 0, 0, 1], STAMP, "base_link")
    vector = vector3_stamped_from_array([1, 2, 3], STAMP, "base_link")
    for message in (pose, vector):
        assert message.header.stamp == STAMP
        assert message.header.frame_id == "base_link"
    np.testing.assert_array_equal(vector3_to_array(vector.vector), [1, 2, 3])


@given(st.permutations(["shoulder", "elbow", "wrist", "gripper"]))
def test_joints_are_matched_by_name(names: list[str]) -> None:
    """In whatever order the message lists them, and with joints that the robot has not."""
    values = {"shoulder": 0.1, "elbow": 0.2, "wrist": 0.3, "gripper": math.nan}
    message = _joint_state(names, [values[name] for name in names])
    np.testing.assert_array_equal(joint_state_to_array(message, JOINTS), [0.1, 0.2, 0.3])


@given(st.lists(finite, min_size=3, max_size=3))
def test_joint_positions_survive_the_round_trip_bit_for_bit(positions: list[float]) -> None:
    """And the message has neither velocities nor efforts."""
    message = joint_state_from_array(positions, JOINTS, STAMP)
    np.testing.assert_array_equal(joint_state_to_array(message, JOINTS), positions)
    assert message.header.stamp == STAMP
    assert len(message.velocity) == len(message.effort) == 0


def test_every_missing_joint_is_named() -> None:
    """And what was received instead."""
    with pytest.raises(MissingJoint) as caught:
        joint_state_to_array(_joint_state(["elbow", "other"], [0.0, 0.0]), JOINTS)
    assert caught.value.missing == ("shoulder", "wrist")
    assert caught.value.received == ("elbow", "other")


@pytest.mark.parametrize(
    ("names", "positions", "problem"),
    [
        (["shoulder", "elbow", "wrist"], [0.0, 0.0], "3 names but 2 positions"),
        (["shoulder", "elbow"], [0.0, 0.0, 0.0], "2 names but 3 positions"),
        (["shoulder", "elbow", "wrist", "elbow"], [0.0] * 4, "elbow is named more than once"),
        (["shoulder", "elbow", "wrist", "x", "x"], [0.0] * 5, "x is named more than once"),
    ],
)
def test_a_malformed_joint_state_is_refused(
    names: list[str], positions: list[float], problem: str
) -> None:
    """A joint named twice has no one position."""
    with pytest.raises(MalformedJointState) as caught:
        joint_state_to_array(_joint_state(names, positions), JOINTS)
    assert problem in caught.value.problem


def test_an_empty_joint_state_lacks_every_joint() -> None:
    """It is well formed all the same."""
    with pytest.raises(MissingJoint) as caught:
        joint_state_to_array(JointState(), JOINTS)
    assert (caught.value.missing, caught.value.received) == (JOINTS, ())


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_joint_position_that_is_not_finite_is_refused_by_name(value: float) -> None:
    """The error names the joint."""
    with pytest.raises(NonFiniteValue) as caught:
        joint_state_to_array(_joint_state(list(JOINTS), [0.0, value, 0.0]), JOINTS)
    assert "elbow" in caught.value.field


@given(st.integers(-(2**31) * 10**9, (2**31) * 10**9 - 1))
def test_a_stamp_survives_the_round_trip_to_the_nanosecond(nanoseconds: int) -> None:
    """Every time that a stamp can hold."""
    assert stamp_to_nanoseconds(stamp_from_nanoseconds(nanoseconds)) == nanoseconds


@pytest.mark.parametrize("nanosec", [10**9, 2**32 - 1])
def test_a_stamp_with_a_second_of_nanoseconds_is_refused(nanosec: int) -> None:
    with pytest.raises(InvalidStamp) as caught:
        stamp_to_nanoseconds(Time(sec=1, nanosec=nanosec))
    assert caught.value.value == nanosec
    assert stamp_to_nanoseconds(Time(sec=1, nanosec=10**9 - 1)) == 2 * 10**9 - 1


@pytest.mark.parametrize("nanoseconds", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_a_time_beyond_a_stamps_range_is_refused(nanoseconds: int) -> None:
    """One nanosecond further does not fit."""
    with pytest.raises(InvalidStamp) as caught:
        stamp_from_nanoseconds(nanoseconds)
    assert caught.value.value == nanoseconds


@pytest.mark.parametrize(
    ("interval", "due"),
    [
        (0.25, [(0, 250_000_000), (0, 500_000_000), (0, 750_000_000)]),
        (1.001, [(1, 1_000_000), (2, 2_000_000), (3, 3_000_000)]),
        (0.009, [(0, 9_000_000), (0, 18_000_000), (0, 27_000_000)]),
    ],
)
def test_the_points_of_a_trajectory_are_an_interval_apart(
    interval: float, due: list[tuple[int, int]]
) -> None:
    """The first one too, from the start; to the nanosecond."""
    rows = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    message = joint_trajectory_from_array(rows, JOINTS, interval)
    assert list(message.joint_names) == list(JOINTS)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (0, 0)
    assert [list(point.positions) for point in message.points] == rows
    times = [(p.time_from_start.sec, p.time_from_start.nanosec) for p in message.points]
    assert times == due
    assert list(position_command_from_array(rows[0]).data) == rows[0]


@pytest.mark.parametrize("shape", [(3,), (2, 2), (1, 3, 1)])
def test_a_trajectory_of_another_number_of_joints_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(WrongShape) as caught:
        joint_trajectory_from_array(np.zeros(shape), JOINTS, 0.1)
    assert (caught.value.what, caught.value.shape) == ("joint positions", shape)
