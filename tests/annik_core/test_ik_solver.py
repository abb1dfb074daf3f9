"""The solver's checks, each refusing in its turn, and what an accepted answer promises. ROS-free.

The network is a stand-in that answers as told, so that every check can be reached.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.acceptance import AcceptanceLimits, InvalidAcceptanceLimit
from annik_core.artifact import default_model_path
from annik_core.errors import WrongShape
from annik_core.gantry import GantryKinematics
from annik_core.ik_result import IkResult, IkStatus
from annik_core.ik_solver import IkSolver
from annik_core.pose import FloatArray, pose_from_roll_pitch_yaw
from annik_core.robot import Robot

IN_WORKSPACE = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], [0.2, 0.3, 0.4])


@dataclass
class StandInNetwork:
    """Answers poses with whatever a function says."""

    robot: Robot
    answer: Callable[[FloatArray], FloatArray]

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """As the artifact's."""
        return self.answer(poses)


@pytest.fixture(scope="module")
def packaged() -> IkSolver:
    """The solver on the packaged model."""
    return IkSolver.from_file(default_model_path())


def solver(robot: Robot, answer: Callable[[FloatArray], FloatArray], **limits: float) -> IkSolver:
    """A solver on a stand-in network."""
    return IkSolver(StandInNetwork(robot, answer), AcceptanceLimits(**limits))  # type: ignore[arg-type]


def exact(robot: Robot) -> Callable[[FloatArray], FloatArray]:
    """The exact inverse, away from the gimbal edge."""
    kinematics = robot.forward_kinematics
    assert isinstance(kinematics, GantryKinematics)
    task = np.concatenate([[0.3, 0.3, 0.6], [0.2, 0.3, 0.4]])
    joints = kinematics.joint_positions(task[np.newaxis])
    return lambda poses: joints.copy()


def no_answer(poses: FloatArray) -> FloatArray:
    """For targets that must not reach the network."""
    raise AssertionError("the network was asked")


@pytest.mark.parametrize(
    ("pose", "status"),
    [
        ([np.nan, 0.3, 0.6, 0, 0, 0, 1], IkStatus.NOT_FINITE),
        ([0.3, 0.3, 0.6, 0, 0, np.inf, 1], IkStatus.NOT_FINITE),
        ([0.3, 0.3, 0.6, 0, 0, 0, 0], IkStatus.NOT_UNIT_QUATERNION),
        ([0.3, 0.3, 0.6, 0, 0, 0, 1.1], IkStatus.NOT_UNIT_QUATERNION),
        ([0.3, 0.3, 1.6, 0, 0, 0, 1], IkStatus.OUTSIDE_WORKSPACE),
        ([1e300, 0.3, 0.6, 0, 0, 0, 1], IkStatus.OUTSIDE_WORKSPACE),
    ],
)
def test_a_bad_target_never_reaches_the_network(
    gantry: Robot, pose: list[float], status: IkStatus
) -> None:
    """It is refused with a reason and carries no joint positions."""
    result = solver(gantry, no_answer).solve(pose)
    assert result.status is status
    assert result.joint_positions is None
    assert not result.accepted
    assert result.reason


def test_an_answer_beyond_the_joint_limits_is_refused(gantry: Robot) -> None:
    """Never clamped: the refusal names the joint, its value and its limits."""
    result = solver(gantry, lambda poses: np.full((1, 6), 1.6)).solve(IN_WORKSPACE)
    assert result.status is IkStatus.JOINT_LIMIT
    assert "x_drive_joint would be 1.6, outside [0, 1.5708]" in result.reason
    assert result.joint_positions is None


def test_an_answer_of_nan_is_refused(gantry: Robot) -> None:
    """NaN compares as neither inside nor outside; it must not pass."""
    result = solver(gantry, lambda poses: np.full((1, 6), np.nan)).solve(IN_WORKSPACE)
    assert result.status is IkStatus.JOINT_LIMIT
    assert result.joint_positions is None


@pytest.mark.parametrize(
    ("joint", "off_by", "expected"),
    [(0, 0.001, "position residual 0.573 mm"), (5, 0.001, "orientation residual 0.1719 degrees")],
)
def test_an_answer_that_misses_the_target_is_refused(
    gantry: Robot, joint: int, off_by: float, expected: str
) -> None:
    """The residual is that of the forward kinematics, on both sides of the limit."""
    answer = exact(gantry)(IN_WORKSPACE)
    answer[0, joint] += off_by
    strict = {"max_position_residual": 0.00057, "max_orientation_residual": 0.0029}
    lax = {"max_position_residual": 0.00058, "max_orientation_residual": 0.0031}
    refused = solver(gantry, lambda poses: answer.copy(), **strict).solve(IN_WORKSPACE)
    assert refused.status is IkStatus.RESIDUAL_TOO_LARGE
    assert expected in refused.reason
    assert refused.joint_positions is None
    accepted = solver(gantry, lambda poses: answer.copy(), **lax).solve(IN_WORKSPACE)
    assert accepted.accepted


def test_a_joint_step_beyond_the_limit_is_refused(gantry: Robot) -> None:
    """Measured from the previous command; without one there is no step."""
    answer = exact(gantry)
    previous = answer(IN_WORKSPACE)[0]
    previous[3] -= 0.11
    bounded = solver(gantry, answer, max_joint_step=0.1)
    refused = bounded.solve(IN_WORKSPACE, previous)
    assert refused.status is IkStatus.JOINT_STEP_TOO_LARGE
    assert "roll_drive_joint would step by 0.11" in refused.reason
    assert bounded.solve(IN_WORKSPACE).accepted


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_limit_that_is_not_positive_is_refused(value: float) -> None:
    """Zero, negative, NaN: nothing or everything would pass."""
    with pytest.raises(InvalidAcceptanceLimit, match="max_joint_step"):
        AcceptanceLimits(max_joint_step=value)


def test_wrong_shape_is_a_fault_of_the_caller(packaged: IkSolver) -> None:
    """Not a refusal: a program that passes six numbers is wrong."""
    with pytest.raises(WrongShape):
        packaged.solve([0.3, 0.3, 0.6, 0, 0, 0])


any_number = st.one_of(st.floats(), st.floats(-1, 1))


@given(st.lists(any_number, min_size=7, max_size=7))
def test_whatever_is_accepted_is_finite_in_limits_and_near(
    packaged: IkSolver, pose: list[float]
) -> None:
    """For any seven numbers at all."""
    result = packaged.solve(pose)
    if result.joint_positions is None:
        assert result.reason
        return
    assert packaged.robot.joint_limits.contains(result.joint_positions)
    assert result.position_residual <= packaged.limits.max_position_residual
    assert result.orientation_residual <= packaged.limits.max_orientation_residual


@given(st.lists(st.floats(20, 50), min_size=6, max_size=6))
def test_every_pose_of_the_workspace_is_answered(packaged: IkSolver, q_deg: list[float]) -> None:
    """Faces, edges and corners included, the gimbal edge too."""
    pose = packaged.robot.forward_kinematics.poses(np.radians([q_deg]))[0]
    result = packaged.solve(pose)
    assert result.accepted, result.reason


@given(st.lists(st.floats(20, 50), min_size=6, max_size=6))
def test_a_quaternion_and_its_negative_are_the_same_target(
    packaged: IkSolver, q_deg: list[float]
) -> None:
    """Same joint positions for both."""
    pose = packaged.robot.forward_kinematics.poses(np.radians([q_deg]))[0]
    negated = np.concatenate([pose[:3], -pose[3:]])
    one, other = packaged.solve(pose), packaged.solve(negated)
    assert one.joint_positions is not None
    assert other.joint_positions == pytest.approx(one.joint_positions, abs=1e-8)


def test_the_same_pose_gives_the_same_answer(packaged: IkSolver) -> None:
    """Bit for bit."""
    first = packaged.solve(IN_WORKSPACE).joint_positions
    assert np.array_equal(first, packaged.solve(IN_WORKSPACE).joint_positions)


def test_a_batch_is_its_rows(packaged: IkSolver) -> None:
    """Good and bad targets in one batch, each answered for itself."""
    bad = np.full(7, np.nan)
    results = packaged.solve_batch([IN_WORKSPACE, bad, IN_WORKSPACE])
    assert [result.status for result in results] == [
        IkStatus.SUCCESS,
        IkStatus.NOT_FINITE,
        IkStatus.SUCCESS,
    ]


def test_an_answer_can_not_be_altered(packaged: IkSolver) -> None:
    """What was checked is what is published."""
    joint_positions = packaged.solve(IN_WORKSPACE).joint_positions
    assert joint_positions is not None
    with pytest.raises(ValueError, match="read-only"):
        joint_positions[0] = 0.0


class TestContinuityAtTheGimbalEdge:
    """A path of small steps gives joint positions of small steps, on to and along the edge."""

    @staticmethod
    def follow(packaged: IkSolver, roll_pitch_yaw_deg: FloatArray) -> FloatArray:
        """Joint positions [degrees] along a path of orientations, each from the one before."""
        previous: IkResult | None = None
        rows = []
        for angles in np.radians(roll_pitch_yaw_deg):
            pose = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], angles)
            result = packaged.solve(pose, previous)
            assert result.joint_positions is not None, result.reason
            assert result.orientation_residual < 1e-3
            previous = result
            rows.append(result.joint_positions)
        return np.degrees(rows)

    @pytest.mark.parametrize(("roll", "yaw"), [(10.0, 80.0), (80.0, 10.0), (30.0, 30.0), (0, 0)])
    def test_on_to_the_edge_and_back(self, packaged: IkSolver, roll: float, yaw: float) -> None:
        """Roll and yaw stay what they were, though at the edge the pose does not tell them."""
        pitch = np.concatenate(
            [np.linspace(80, 90, 51), [90 - 1e-7, 90, 90], np.linspace(90, 80, 51)]
        )
        path = np.column_stack([np.full(len(pitch), roll), pitch, np.full(len(pitch), yaw)])
        joints = self.follow(packaged, path)
        assert np.abs(np.diff(joints, axis=0)).max() < 0.08
        assert joints[:, 3] == pytest.approx((roll + 60) / 3, abs=0.02)
        assert joints[:, 5] == pytest.approx((yaw + 60) / 3, abs=0.02)

    def test_holding_a_pose_on_the_edge(self, packaged: IkSolver) -> None:
        """The same target again and again gives the same joint positions."""
        path = np.tile([5.0, 90.0, 85.0], (1000, 1))
        joints = self.follow(packaged, np.vstack([[5.0, 89.9, 85.0], path]))
        assert np.ptp(joints[1:], axis=0).max() < 1e-9

    def test_the_residual_is_measured_against_the_target_itself(self, gantry: Robot) -> None:
        """Not against the pose that stands in for it on the edge."""
        kinematics = gantry.forward_kinematics
        assert isinstance(kinematics, GantryKinematics)
        tilted = np.array([[0.3, 0.3, 0.6, 0.7, np.pi / 2 - 1e-7, 0.7]])
        answer = kinematics.joint_positions(tilted)
        target = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], [0.7, np.pi / 2, 0.7])
        result = solver(gantry, lambda poses: answer.copy()).solve(target)
        assert result.orientation_residual == pytest.approx(1e-7, rel=0.2)

    def test_along_the_edge(self, packaged: IkSolver) -> None:
        """Turning at a pitch of 90 degrees moves roll and yaw evenly."""
        roll = np.linspace(0, 90, 91)
        path = np.column_stack([roll, np.full(91, 90.0), 90 - roll])
        joints = self.follow(packaged, path)
        assert np.abs(np.diff(joints, axis=0)).max() < 0.4
