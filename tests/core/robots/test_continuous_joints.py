"""A continuous joint is at the same place after a full turn. ROS-free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from support.continuous_arm import CONTINUOUS_URDF, OPTIONS, TURNING

from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.corrections import ArmCorrections, ErrorBound, JointNetworks, PoseNetwork
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.safety import Candidate

ROBOT = load_robot(CONTINUOUS_URDF, **OPTIONS)
TURN = 2.0 * math.pi

positions = arrays(np.float64, 6, elements=st.floats(-40, 40))
turns = arrays(np.int64, 6, elements=st.integers(-5, 5)).map(
    lambda counts: np.where(np.isin(np.arange(6), TURNING), counts, 0)
)


def corrected() -> Robot:
    """The arm with every kind of correction, as a calibration finds them."""
    rng = np.random.default_rng(2)
    placements = np.tile([0.0, 0, 0, 0, 0, 0, 1], (7, 1))
    scale = ROBOT.joint_box.centre, 0.5 * (ROBOT.joint_box.upper - ROBOT.joint_box.lower)
    corrections = ArmCorrections(
        placements,
        JointNetworks(*scale, *rng.normal(scale=[[[1.0]], [[1.0]], [[0.01]]], size=(3, 6, 4))),
        PoseNetwork(
            *scale, rng.normal(size=(3, 6)), rng.normal(size=3), 1e-3 * rng.normal(size=(6, 3))
        ),
        ErrorBound(*scale, rng.normal(size=(2, 28)) - 0.5),
    )
    return robot_from_definition(
        {**ROBOT.definition, "corrections": corrections.to_dict()}, "test"
    )


def test_the_definition_keeps_the_type_and_leads_to_the_same_robot() -> None:
    assert ROBOT.joint_types == ("continuous", *("revolute",) * 4, "continuous")
    again = robot_from_definition(ROBOT.definition, "test")
    assert again.joint_types == ROBOT.joint_types
    assert again.definition_hash == ROBOT.definition_hash


def test_a_revolute_joint_of_two_turns_is_not_circular() -> None:
    """At its limits it is at the same place, and as far apart as can be."""
    text = CONTINUOUS_URDF.replace('type="continuous"', 'type="revolute"')
    text = text.replace('lower="-2.9" upper="2.9"', f'lower="{-TURN}" upper="{TURN}"')
    robot = load_robot(text, **OPTIONS)
    lower, upper = robot.joint_limits.lower, robot.joint_limits.upper
    np.testing.assert_array_equal(robot.difference(upper, lower), upper - lower)
    assert robot.unwrapped(upper, lower) is upper
    assert robot.search_box is robot.joint_box


@given(positions, positions, turns)
def test_the_difference_is_the_shorter_way_around(
    start: FloatArray, to: FloatArray, count: FloatArray
) -> None:
    difference = ROBOT.difference(to, start)
    linear = [joint for joint in range(6) if joint not in TURNING]
    np.testing.assert_array_equal(difference[linear], (to - start)[linear])
    assert np.abs(difference[TURNING]).max() <= math.pi + 1e-12
    np.testing.assert_allclose(np.exp(1j * difference), np.exp(1j * (to - start)), atol=1e-12)
    # However the turns are counted; half a turn may go either way.
    again = np.abs(ROBOT.difference(to + TURN * count, start))
    np.testing.assert_allclose(again, np.abs(difference), atol=1e-12)


def test_the_difference_of_the_case_at_the_seam() -> None:
    measured, target = np.full(6, -3.1), np.full(6, 3.1)
    expected = np.where(np.isin(np.arange(6), TURNING), 6.2 - TURN, 6.2)
    np.testing.assert_allclose(ROBOT.difference(target, measured), expected)
    rows = ROBOT.difference(np.array([target, measured]), measured)
    np.testing.assert_allclose(rows, [expected, np.zeros(6)], atol=1e-15)


@given(positions, positions)
def test_unwrapped_is_the_same_place_nearest_to_the_reference(
    place: FloatArray, reference: FloatArray
) -> None:
    given_place = place.copy()
    near = ROBOT.unwrapped(place, reference)
    np.testing.assert_allclose(near - reference, ROBOT.difference(place, reference), atol=1e-12)
    np.testing.assert_array_equal(place, given_place)


@pytest.mark.parametrize("robot", [ROBOT, corrected()], ids=["described", "corrected"])
@given(place=positions, count=turns)
def test_the_kinematics_do_not_depend_on_the_turns(
    robot: Robot, place: FloatArray, count: FloatArray
) -> None:
    kinematics = robot.forward_kinematics
    # Off the seam, where rounding decides which turn it is.
    place = robot.in_box(place) + np.where(np.isin(np.arange(6), TURNING), 1e-9, 0.0)
    both = np.array([place, place + TURN * count])
    distances, angles = pose_distance(*kinematics.poses(both)[:, np.newaxis])
    assert max(distances[0], angles[0]) < 1e-9
    one, other = kinematics.jacobians(both)
    np.testing.assert_allclose(one, other, atol=1e-9)
    target = kinematics.poses(ROBOT.joint_box.centre[np.newaxis])[0]
    there, after_turns = (kinematics.linearise(q, target) for q in both)
    np.testing.assert_allclose(there.jacobian, after_turns.jacobian, atol=1e-9)
    assert there.residuals == pytest.approx(after_turns.residuals, abs=1e-9)


@given(place=positions, count=turns)
def test_the_expected_error_does_not_depend_on_the_turns(
    place: FloatArray, count: FloatArray
) -> None:
    robot = corrected()
    place = robot.in_box(place)
    target = np.array([0.0, 0, 0, 0, 0, 0, 1])
    one, other = (
        Candidate(robot, target, q).expected_errors() for q in (place, place + TURN * count)
    )
    assert one == pytest.approx(other, rel=1e-6)


def test_the_search_passes_the_seam_and_only_there() -> None:
    """A joint with a part of the turn for its box stays inside."""
    box = ROBOT.search_box
    assert (box.lower[0], box.upper[0]) == (-math.inf, math.inf)
    np.testing.assert_array_equal(box.lower[1:], ROBOT.joint_box.lower[1:])
    np.testing.assert_array_equal(box.upper[1:], ROBOT.joint_box.upper[1:])


@pytest.mark.parametrize("position", [1e9 + 1.0, -2e9, math.inf, math.nan])
def test_numbers_that_are_no_angle_are_outside_the_limits(position: float) -> None:
    place = ROBOT.joint_box.centre.copy()
    place[0] = 1000.0
    assert ROBOT.joint_limits.violation(place) is None
    place[0] = position
    assert "swivel" in str(ROBOT.joint_limits.violation(place))
