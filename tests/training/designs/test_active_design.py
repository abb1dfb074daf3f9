"""The adaptive design: few examples where the networks agree, more where they don't. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from annik_core.errors import InvalidValue
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.designs.active_design import _spread_out
from annik_training.designs.registry import DESIGNS, make_design
from annik_training.designs.sampling_designs import random_design, sobol_design
from annik_training.errors import UnsupportedRobot
from benchmarks.systems.elbow_arm import ElbowArm
from benchmarks.systems.function_system import FunctionSystem


def function_of(dof: int) -> FunctionSystem:
    """The sum of the joints: what is learned matters little to these tests."""
    names = tuple(f"q{number}" for number in range(dof))
    box = JointLimits(names, np.full(dof, -0.5), np.linspace(0.5, 2.0, dof))
    return FunctionSystem(
        "sum",
        box,
        (np.array([-10.0]), np.array([10.0])),
        lambda q: q.sum(axis=1, keepdims=True),
        lambda q: np.ones((len(q), 1, q.shape[1])),
    )


@pytest.mark.parametrize("dof", range(2, 9))
def test_size_box_and_no_row_twice(dof: int) -> None:
    system = function_of(dof)
    rows = make_design(system, "active", 2 * dof + 3, seed=dof)
    assert rows.shape == (2 * dof + 3, dof)
    assert system.joint_box.contains(rows)
    assert len(np.unique(rows, axis=0)) == len(rows)


@pytest.mark.slow
def test_same_seed_same_examples() -> None:
    first = make_design(ElbowArm(), "active", 12, seed=1)
    assert np.array_equal(first, make_design(ElbowArm(), "active", 12, seed=1))
    assert not np.array_equal(first, make_design(ElbowArm(), "active", 12, seed=2))


def test_it_begins_with_a_sobol_sequence() -> None:
    rows = make_design(ElbowArm(), "active", 9, seed=3)
    begin = sobol_design(ElbowArm().joint_box, 6, np.random.default_rng(3))
    assert np.array_equal(rows[:6], begin)


def test_the_most_disputed_come_first_but_not_side_by_side() -> None:
    """Five candidates on a line, two of them, close to each other, far more disputed."""
    candidates = np.array([[0.1], [0.3], [0.60], [0.62], [0.9]])
    spread = np.array([1.0, 1.0, 10.0, 9.0, 2.0])
    assert _spread_out(spread, candidates, np.array([[0.0]]), 2) == [2, 4]


def constant_in(box: JointLimits) -> FunctionSystem:
    """A constant is learned at once: then distance alone decides."""
    return FunctionSystem(
        "constant",
        box,
        (-np.ones(1), np.ones(1)),
        lambda q: np.zeros((len(q), 1)),
        lambda q: np.zeros((len(q), 1, 2)),
    )


def test_where_all_agree_the_box_is_filled() -> None:
    """No two are close."""
    box = JointLimits(("q1", "q2"), -np.ones(2), np.ones(2))
    added = make_design(constant_in(box), "active", 24, seed=0)[4:]
    drawn = random_design(box, 20, np.random.default_rng(0))
    assert pdist(added).min() > 3 * pdist(drawn).min()


def test_distances_are_relative_to_the_widths_of_the_box() -> None:
    """Which may be in radians and metres."""
    widths = np.array([1.0, 1000.0])
    designs = [
        make_design(constant_in(JointLimits(("q1", "q2"), -half, half)), "active", 16, seed=0)
        for half in (np.ones(2), widths)
    ]
    np.testing.assert_allclose(designs[1] / widths, designs[0], atol=1e-12)


def test_it_works_for_a_robot(gantry: Robot) -> None:
    rows = make_design(gantry, "active", 14, seed=0)
    assert rows.shape == (14, 6)
    assert gantry.joint_box.contains(rows)


def test_without_forward_kinematics_it_is_refused() -> None:
    class Subject:
        name = "table"
        joint_box = JointLimits(("q1",), np.zeros(1), np.ones(1))

    with pytest.raises(UnsupportedRobot) as caught:
        make_design(Subject(), "active", 5, seed=0)
    assert (caught.value.robot, caught.value.purpose) == ("table", "design active")
    assert "forward kinematics" in caught.value.reason


@pytest.mark.parametrize("examples", [0, DESIGNS["active"].size.maximum + 1])
def test_size_out_of_range(examples: int) -> None:
    with pytest.raises(InvalidValue) as caught:
        make_design(ElbowArm(), "active", examples, seed=0)
    assert (caught.value.value, caught.value.allowed) == (examples, "1 to 2000")
    assert "active" in caught.value.name
