"""A suggested joint box: on one branch, around what was asked, large. ROS-free."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from support.six_joint_arm import BASE, BOX, FLANGE, URDF
from support.urdf_texts import planar_arm

from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.joint_box import findings
from annik_training.suggested_box import NoSuggestion, suggested_box

KINOVA = Path(__file__).parents[3] / "shared" / "robots" / "kinova_gen3.urdf"


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE)


@pytest.fixture(scope="module")
def box(arm: Robot) -> JointLimits:
    return suggested_box(arm, np.array([0.0, -0.8, 1.1, 0.0, 1.0, 0.0]))


def test_it_has_no_singularity(arm: Robot, box: JointLimits) -> None:
    """The determinant has one sign at as many joint positions as one likes, corners among them."""
    rng = np.random.default_rng(7)
    inside = box.sample(20_000, rng)
    corners = np.where(rng.uniform(size=(5_000, 6)) < 0.5, box.lower, box.upper)
    signs = np.sign(
        np.linalg.det(arm.forward_kinematics.jacobians(np.concatenate([inside, corners])))
    )
    assert np.mean(signs == np.median(signs)) > 0.9999


def test_it_is_larger_than_one_chosen_by_hand(arm: Robot, box: JointLimits) -> None:
    """And inside the limits, less than a full turn."""
    by_hand = math.prod(upper - lower for lower, upper in BOX.values())
    assert np.prod(box.upper - box.lower) > 20.0 * by_hand
    limits = arm.joint_limits
    assert (box.lower >= limits.lower).all()
    assert (box.upper <= limits.upper).all()


def test_a_model_with_it_is_on_one_branch(arm: Robot, box: JointLimits) -> None:
    bounds = {
        name: [float(low), float(high)]
        for name, low, high in zip(box.joint_names, box.lower, box.upper, strict=True)
    }
    boxed = load_robot(URDF, base_frame=BASE, end_effector_frame=FLANGE, joint_box=bounds)
    assert findings(boxed)[-1].startswith("one branch")


def test_of_three_joints_the_exact_box_is_known() -> None:
    """The elbow of a planar arm is singular at zero."""
    found = suggested_box(load_robot(planar_arm()), np.array([0.5, 1.0, -0.5]))
    assert -0.1 < found.lower[1] - 0.0 < 0.1
    assert found.upper[1] == pytest.approx(3.0, abs=0.1)


def test_where_there_is_none(arm: Robot, gantry: Robot) -> None:
    for around in (np.zeros(6), np.full(6, 9.0)):
        with pytest.raises(NoSuggestion):
            suggested_box(arm, around)
    with pytest.raises(NoSuggestion):
        suggested_box(gantry)


def test_a_joint_that_is_locked_stays_so() -> None:
    """Of seven joints one, at the joint positions that were asked for."""
    robot = load_robot("panda", joint_box={"panda_joint3": [0.0, 0.0]})
    around = np.array([0.0, 0.0, 0.3, -1.5, 0.0, 1.8, 0.0])
    found = suggested_box(robot, around)
    assert found.free.tolist() == [0, 1, 3, 4, 5, 6]
    assert found.lower[2] == around[2]
    assert found.contains(around)


@pytest.mark.skipif(not KINOVA.is_file(), reason="../shared/robots is not beside this checkout")
def test_it_is_around_what_is_regular_without_the_redundant_joint() -> None:
    """With all seven joints another place is the farthest from a singularity."""
    robot = load_robot(KINOVA, base_frame="base_link", end_effector_frame="EndEffector_Link")
    found = suggested_box(robot)
    assert len(found.free) == 6
    jacobians = robot.forward_kinematics.jacobians(found.sample(5_000, np.random.default_rng(7)))
    signs = np.sign(np.linalg.det(jacobians[:, :, found.free]))
    assert np.mean(signs == np.median(signs)) > 0.9999
    assert np.prod((found.upper - found.lower)[found.free] / (2.0 * math.pi)) > 0.01
