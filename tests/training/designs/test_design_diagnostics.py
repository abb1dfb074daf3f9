"""Diagnostics of designs whose properties are known. ROS-free."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from annik_core.robots.gantry import TASK_COORDINATES
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.designs.diagnostics import diagnose
from annik_training.designs.registry import make_design


def box(dof: int) -> JointLimits:
    return JointLimits.from_bounds([f"q{n + 1}" for n in range(dof)], [-1] * dof, [1] * dof)


@pytest.mark.parametrize("steps", [1, 2, 3, 6, 15])
def test_the_papers_design_is_blind_to_what_was_proven(gantry: Robot, steps: int) -> None:
    """Rank 24 of 28, and only products of two different joints are affected."""
    rows = make_design(gantry, "thirty_phase", steps, seed=0)
    diagnostics = diagnose(rows, gantry.joint_box)
    assert (diagnostics.linear.rank, diagnostics.linear.terms) == (7, 7)
    assert (diagnostics.quadratic.rank, diagnostics.quadratic.terms) == (24, 28)
    assert set(diagnostics.blind_interactions) == {
        (f"{first}_drive_joint", f"{second}_drive_joint")
        for first, second in itertools.combinations(TASK_COORDINATES, 2)
        if (first, second) not in (("x", "y"), ("z", "roll"), ("pitch", "yaw"))
    }


@pytest.mark.parametrize(
    ("design", "size"),
    [
        ("thirty_phase_plus", 1),
        ("thirty_phase_plus", 3),
        ("central_composite", 1),
        ("sobol", 102),
        ("latin_hypercube", 102),
    ],
)
def test_designs_that_see_every_interaction(gantry: Robot, design: str, size: int) -> None:
    diagnostics = diagnose(make_design(gantry, design, size, seed=0), gantry.joint_box)
    assert diagnostics.quadratic.rank == 28
    assert diagnostics.blind_interactions == ()


def test_a_full_factorial_of_two_levels_sees_products_but_not_squares() -> None:
    """Squares are the constant there; products are orthogonal."""
    rows = np.array(list(itertools.product([-1.0, 1.0], repeat=3)))
    diagnostics = diagnose(rows, box(3))
    assert diagnostics.quadratic.rank == 1 + 3 + 3
    assert diagnostics.blind_interactions == ()
    assert diagnostics.linear.condition == pytest.approx(1.0)


def test_condition_numbers_are_those_of_the_whole_matrix() -> None:
    rows = np.random.default_rng(1).uniform(-1, 1, (50, 2))
    first, second = rows.T
    columns = np.stack([np.ones(50), first, second, first**2, first * second, second**2], axis=1)
    diagnostics = diagnose(rows, box(2))
    assert diagnostics.linear.condition == pytest.approx(np.linalg.cond(columns[:, :3]))
    assert diagnostics.quadratic.condition == pytest.approx(np.linalg.cond(columns))


def test_fewer_examples_than_terms() -> None:
    diagnostics = diagnose(np.array([[0.5, -0.5], [0.25, 1.0]]), box(2))
    assert (diagnostics.linear.rank, diagnostics.quadratic.rank) == (2, 2)
    assert diagnostics.blind_interactions == (("q1", "q2"),)


def test_many_examples_need_little_memory() -> None:
    """A square matrix of this many rows would be 80 GB."""
    rows = np.random.default_rng(2).uniform(-1, 1, (100_000, 2))
    assert diagnose(rows, box(2)).quadratic.rank == 6


def test_the_ball_in_an_empty_box_reaches_the_walls() -> None:
    """All examples in one corner: the ball around the centre is half the box wide."""
    diagnostics = diagnose(np.full((5, 2), 1.0), box(2))
    assert diagnostics.examples == 1
    assert diagnostics.largest_empty_ball == pytest.approx(1 / np.sqrt(2), abs=0.02)


def test_a_locked_joint_takes_no_part() -> None:
    locked = JointLimits.from_bounds(["a", "b", "c"], [-1, 0.5, -1], [1, 0.5, 1])
    rows = np.random.default_rng(0).uniform(locked.lower, locked.upper, (30, 3))
    assert diagnose(rows, locked).quadratic.terms == 6
