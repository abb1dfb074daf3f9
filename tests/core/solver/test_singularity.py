"""Across a fold: from the neighbourhood of one solution to that of the other. ROS-free.

The planar arm has its folds where the elbow is straight or bent back on itself, and the
determinant of its Jacobian is the sine of the elbow.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.urdf_texts import planar_arm

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.solver.refinement import reflected_across_singularity

#: Never farther than this [rad], as the module says.
FARTHEST = 1.5
ALL = np.arange(3)


@pytest.fixture(scope="module")
def planar() -> Robot:
    return load_robot(planar_arm())


def jacobian_of(robot: Robot):
    """``(6, dof)`` at joint positions, in the base frame."""
    return lambda q: robot.forward_kinematics.jacobians(q[None])[0]


def side(robot: Robot, q: FloatArray) -> float:
    """The sign of the determinant of the planar Jacobian: x, y and the angle."""
    return float(np.sign(np.linalg.det(jacobian_of(robot)(q)[[0, 1, 5]])))


@given(
    st.floats(-2.5, 2.5),
    st.one_of(st.floats(0.02, 0.6), st.floats(-0.6, -0.02)),
    st.floats(-2.5, 2.5),
)
def test_the_other_side_of_the_straight_elbow_is_reached(
    planar: Robot, shoulder: float, elbow: float, wrist: float
) -> None:
    q = np.array([shoulder, elbow, wrist])
    beyond = reflected_across_singularity(jacobian_of(planar), q, ALL)
    assert side(planar, beyond) == -side(planar, q)
    assert np.sign(beyond[1]) == -np.sign(elbow)
    assert np.linalg.norm(beyond - q) <= FARTHEST + 1e-12


def two_joint_jacobian(q: FloatArray) -> FloatArray:
    """2x2, of an arm with links of 1 and 0.6 m in the plane."""
    a, b = q[0], q[0] + q[1]
    return np.array(
        [
            [-math.sin(a) - 0.6 * math.sin(b), -0.6 * math.sin(b)],
            [math.cos(a) + 0.6 * math.cos(b), 0.6 * math.cos(b)],
        ]
    )


@given(
    st.sampled_from([0.0, math.pi, -math.pi]),
    st.one_of(st.floats(0.02, 0.4), st.floats(-0.4, -0.02)),
    st.floats(-3, 3),
)
def test_the_elbow_bent_back_is_a_fold_like_the_straight_one(
    fold: float, aside: float, shoulder: float
) -> None:
    """By a Jacobian written out here: any function of that kind will do."""
    q = np.array([shoulder, fold + aside])
    beyond = reflected_across_singularity(two_joint_jacobian, q, np.arange(2))
    assert np.sign(beyond[1] - fold) == -np.sign(aside)
    assert np.linalg.norm(beyond - q) <= FARTHEST + 1e-12
    determinants = [np.linalg.det(two_joint_jacobian(side)) for side in (q, beyond)]
    assert determinants[0] * determinants[1] < 0


def test_joints_that_are_not_free_stay(planar: Robot) -> None:
    q = np.array([0.3, 0.2, -0.7])
    for free in ([0, 1], [1, 2], [1]):
        beyond = reflected_across_singularity(jacobian_of(planar), q, np.array(free))
        locked = [joint for joint in range(3) if joint not in free]
        assert np.array_equal(beyond[locked], q[locked])


def test_without_a_fold_nothing_moves() -> None:
    """A Jacobian that is the same everywhere has none, whether or not it has its full rank."""
    q = np.array([0.1, 0.2, 0.3])
    for constant in (np.eye(6)[:, :3], np.diag([3.0, 2.0, 1.0, 0, 0, 0])[:, :3], np.zeros((6, 3))):
        assert np.array_equal(reflected_across_singularity(lambda q, c=constant: c, q, ALL), q)


def test_one_joint_has_no_fold(planar: Robot) -> None:
    q = np.array([0.3, 0.2, -0.7])
    assert np.array_equal(reflected_across_singularity(jacobian_of(planar), q, np.array([2])), q)


def test_the_joint_positions_given_are_not_altered(planar: Robot) -> None:
    q = np.array([0.3, 0.2, -0.7])
    kept = q.copy()
    assert not np.array_equal(reflected_across_singularity(jacobian_of(planar), q, ALL), kept)
    assert np.array_equal(q, kept)


def test_on_the_fold_itself_nothing_moves(planar: Robot) -> None:
    """There both sides are equally near."""
    q = np.array([0.3, 0.0, -0.7])
    assert reflected_across_singularity(jacobian_of(planar), q, ALL) == pytest.approx(q, abs=1e-9)


@pytest.mark.parametrize("aside", [0.1, -0.1])
def test_the_elbow_of_a_ur5e_is_turned_over(aside: float) -> None:
    """The determinant of its whole Jacobian changes its sign."""
    robot = load_robot("ur5e")
    jacobian = jacobian_of(robot)
    q = robot.joint_box.centre.copy()
    q[2] = aside
    beyond = reflected_across_singularity(jacobian, q, np.arange(6))
    assert np.sign(beyond[2]) == -np.sign(aside)
    assert np.sign(np.linalg.det(jacobian(beyond))) == -np.sign(np.linalg.det(jacobian(q)))
