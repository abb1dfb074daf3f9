"""Ways between examples stay inside the joint limits and the workspace box. ROS-free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.continuous_arm import CONTINUOUS_URDF, OPTIONS
from support.urdf_texts import planar_arm

from annik_core.collection.motion import approach, place_violation
from annik_core.robots.library import load_robot
from annik_core.safety import CommandSafety

SPACING = 0.01
EVERYWHERE = CommandSafety()


@pytest.fixture(scope="module")
def scara():
    return load_robot("scara")


def box_around(positions, margin: float) -> CommandSafety:
    return CommandSafety(
        workspace_box_lower=tuple(positions.min(axis=0) - margin),
        workspace_box_upper=tuple(positions.max(axis=0) + margin),
    )


def ends(robot):
    """Two places that are as far apart as the joint box, in the first joint."""
    start, target = robot.joint_box.centre.copy(), robot.joint_box.centre.copy()
    start[0], target[0] = robot.joint_box.lower[0], robot.joint_box.upper[0]
    return start, target


def test_without_a_box_the_way_is_straight(scara) -> None:
    start, target = ends(scara)
    way = approach(scara, EVERYWHERE, start, target, SPACING)
    assert way.violation is None
    assert (way.waypoints == [start, target]).all()


def test_continuous_joints_go_the_shorter_way_also_through_the_centre() -> None:
    robot = load_robot(CONTINUOUS_URDF, **OPTIONS)
    start, target = robot.joint_box.centre, robot.joint_box.centre
    start[0], target[0] = 4 * math.pi + 3.0, -3.0
    way = approach(robot, EVERYWHERE, start, target, SPACING)
    assert np.diff(way.waypoints[:, 0]) == pytest.approx([2 * math.pi - 6.0])
    assert (way.waypoints[:, 1:] == [start[1:], target[1:]]).all()
    # The arc around the seam is out of this box, and the other way around is not.
    positions = robot.forward_kinematics.poses(np.array([start, target]))[:, :3]
    around = CommandSafety(workspace_box_lower=(float(positions[:, 0].min()) - 1e-3, -9, -9))
    way = approach(robot, around, start, target, SPACING)
    assert np.diff(way.waypoints[:, 0]) == pytest.approx([-3.0, -3.0])


def test_an_arc_between_two_checked_points_is_kept_inside_too() -> None:
    """The arm is stretched along x in between, and reaches 2 m there."""
    robot = load_robot(planar_arm())
    start, target = np.array([[-0.5, 0.0, 0.0], [0.7, 0.0, 0.0]])
    # The only point in between.
    checked = robot.forward_kinematics.poses(0.5 * (start + target)[np.newaxis])[0, 0]
    assert checked < 1.995
    for greatest, inside in ((1.995, False), (2.3, True)):
        box = CommandSafety(workspace_box_upper=(greatest, math.inf, math.inf))
        violation = approach(robot, box, start, target, 1.0).violation
        assert (violation is None) == inside
        assert inside or "position.x" in violation


def test_a_target_outside_the_joint_limits_has_no_way(scara) -> None:
    start, target = ends(scara)
    target[0] = scara.joint_limits.upper[0] + 0.1
    way = approach(scara, EVERYWHERE, start, target, SPACING)
    assert way.waypoints is None
    assert scara.joint_names[0] in way.violation


def test_a_way_that_bulges_out_of_the_box_has_its_reason(scara) -> None:
    """Both ends are inside; the arc between them, and the middle of the joint box, are not."""
    start, target = ends(scara)
    positions = scara.forward_kinematics.poses(np.array([start, target]))[:, :3]
    safety = box_around(positions, 0.01)
    for place in (start, target):
        assert place_violation(scara, safety, place) is None
    way = approach(scara, safety, start, target, SPACING)
    assert way.waypoints is None
    assert "on the path position." in way.violation
    assert "the workspace box allows" in way.violation


def test_it_goes_by_the_centre_of_the_joint_box_where_only_that_is_allowed(scara) -> None:
    lower, upper = scara.joint_box.lower, scara.joint_box.upper
    centre = scara.joint_box.centre
    for seed in range(200):
        rng = np.random.default_rng(seed)
        start, target = rng.uniform(lower, upper, (2, scara.dof))
        legs = [
            one + np.linspace(0, 1, 200)[:, None] * (other - one)
            for one, other in ((start, centre), (centre, target))
        ]
        positions = scara.forward_kinematics.poses(np.vstack(legs))[:, :3]
        safety = box_around(positions, 1e-3)
        way = approach(scara, safety, start, target, SPACING)
        assert way.waypoints is not None
        if way.violation is None and len(way.waypoints) == 3:
            assert (way.waypoints == [start, centre, target]).all()
            return
    pytest.fail("no pair of places whose straight way leaves the box of the other one")


def test_what_lies_between_the_points_that_are_looked_at_is_inside_too(scara) -> None:
    """Looked at again a hundred times closer."""
    rng = np.random.default_rng(1)
    allowed = 0
    for _ in range(60):
        start, target = scara.joint_box.sample(2, rng)
        positions = scara.forward_kinematics.poses(np.array([start, target]))[:, :3]
        safety = box_around(positions, rng.uniform(0.0, 0.2))
        way = approach(scara, safety, start, target, 0.2)
        if way.waypoints is None or len(way.waypoints) == 3:
            continue
        allowed += 1
        line = start + np.linspace(0, 1, 2001)[:, None] * (target - start)
        positions = scara.forward_kinematics.poses(line)[:, :3]
        assert (positions >= safety.workspace_box_lower).all()
        assert (positions <= safety.workspace_box_upper).all()
    assert allowed > 5


def test_a_place_outside_the_box_names_coordinate_and_bounds(scara) -> None:
    safety = CommandSafety(workspace_box_upper=(math.inf, math.inf, -5.0))
    violation = place_violation(scara, safety, scara.joint_box.centre)
    assert violation is not None
    assert "position.z" in violation
    assert "-5 m" in violation
