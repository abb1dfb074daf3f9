"""The design for measuring an arm: where its errors show best. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
from support.arm_corrections import corrected, identity_corrections

from annik_core.errors import InvalidValue
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise, Observations
from annik_training.designs.registry import make_design
from annik_training.errors import UnsupportedRobot

UR5E = load_robot("ur5e")
EXAMPLES = 20
#: All that the errors of an arm are described by.
PARTS = frozenset({Part.GEOMETRY, Part.ALIGNMENT, Part.DEFLECTION, Part.JOINT_SERIES})


@pytest.fixture(scope="module")
def design() -> np.ndarray:
    return make_design(UR5E, "identifiability", EXAMPLES, 3)


def information(robot: Robot, joint_positions: np.ndarray, seed: int) -> float:
    """Log-determinant of what these joint positions tell of robots that it was not made for."""
    model = ParametricModel(robot, PARTS)
    parameters = 0.1 * np.random.default_rng(seed).normal(size=model.size)
    count = len(joint_positions)
    nowhere = Observations(
        joint_positions,
        np.zeros((count, 3)),
        np.tile(np.eye(3), (count, 1, 1)),
        has_orientation=True,
        weights=np.ones(count),
    )
    fitted = Estimate(model, parameters, nowhere, Noise(5e-5, 5e-5))
    return -float(np.linalg.slogdet(fitted.covariance)[1])


def test_is_inside_the_box(design: np.ndarray) -> None:
    assert design.shape == (EXAMPLES, 6)
    assert UR5E.joint_box.contains(design)
    assert len(np.unique(design, axis=0)) == EXAMPLES


def test_is_the_same_for_the_same_seed(design: np.ndarray) -> None:
    assert np.array_equal(make_design(UR5E, "identifiability", EXAMPLES, 3), design)
    assert not np.array_equal(make_design(UR5E, "identifiability", EXAMPLES, 4), design)


def test_a_smaller_one_is_its_beginning(design: np.ndarray) -> None:
    """The best come first, so that a measurement may be cut short."""
    assert np.array_equal(make_design(UR5E, "identifiability", 5, 3), design[:5])


@pytest.mark.parametrize("other", ["random", "sobol", "latin_hypercube"])
def test_tells_more_than_others(design: np.ndarray, other: str) -> None:
    for seed in range(3):
        others = make_design(UR5E, other, EXAMPLES, seed)
        assert information(UR5E, design, 10 + seed) > information(UR5E, others, 10 + seed) + 5.0


def test_each_example_adds_the_most(design: np.ndarray) -> None:
    """A plain calculation of the greedy choice gives the same."""
    rng = np.random.default_rng(3)
    model = ParametricModel(UR5E, PARTS)
    candidates = UR5E.joint_box.sample(1000, rng)
    columns = model.evaluate(np.zeros(model.size), candidates).columns / 5e-5
    precision = np.eye(model.size)
    for chosen in design[:3]:
        covariance = np.linalg.inv(precision)
        gains = np.linalg.slogdet(np.eye(6) + columns @ covariance @ columns.swapaxes(1, 2))[1]
        best = int(np.argmax(gains))
        assert np.array_equal(candidates[best], chosen)
        precision += columns[best].T @ columns[best]


@pytest.mark.parametrize("name", ["iiwa14", "scara"])
def test_keeps_a_locked_joint_and_a_prismatic_one_in_the_box(name: str) -> None:
    robot = load_robot(name)
    design = make_design(robot, "identifiability", 8, 0)
    assert robot.joint_box.contains(design)
    locked = robot.joint_box.upper == robot.joint_box.lower
    assert (design[:, locked] == robot.joint_box.lower[locked]).all()
    assert (design[:, ~locked].std(axis=0) > 0.0).all()


@pytest.mark.parametrize("examples", [0, -1, 1001])
def test_of_too_few_or_too_many_is_refused(examples: int) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(UR5E, "identifiability", examples, 0)
    assert (caught.value.value, caught.value.allowed) == (examples, "1 to 1000")


def test_is_for_nominal_arms_only(gantry: Robot) -> None:
    calibrated = corrected(UR5E, identity_corrections(UR5E))
    for robot, purpose, reason in (
        (gantry, "design identifiability", "no arm with a URDF"),
        (calibrated, "calibration", "nominal description"),
    ):
        with pytest.raises(UnsupportedRobot) as caught:
            make_design(robot, "identifiability", 8, 0)
        assert caught.value.purpose == purpose
        assert robot.name in caught.value.robot and reason in caught.value.reason
