"""The evaluation finds the errors that are there. ROS-free."""

from __future__ import annotations

import numpy as np
import pytest

from annik_core.robots.robot import Robot
from annik_training.designs.registry import random_dataset
from annik_training.evaluation import ErrorSummary, network_errors


def test_the_exact_inverse_has_no_error(gantry: Robot) -> None:
    unseen = random_dataset(gantry, gantry.joint_box, 100, seed=1)
    evaluation = network_errors(lambda poses: unseen.joint_positions, unseen).summary()
    assert evaluation.position_error.max < 1e-12
    assert evaluation.orientation_error.max < 1e-7
    assert evaluation.outside_joint_limits == 0.0


def test_a_known_error_is_found(gantry: Robot) -> None:
    """Half a degree of the x drive is 5 mm, eq. (13)."""
    unseen = random_dataset(gantry, gantry.joint_box, 100, seed=1)
    off = unseen.joint_positions + np.radians([0.5, 0, 0, 0, 0, 0])
    evaluation = network_errors(lambda poses: off, unseen).summary()
    assert vars(evaluation.position_error) == pytest.approx(
        dict.fromkeys(("rms", "p50", "p95", "p99", "max"), 5e-3)
    )


def test_a_known_rotation_error_is_found(gantry: Robot) -> None:
    """A tenth of a degree of the yaw drive turns the end effector by 0.3 degrees."""
    unseen = random_dataset(gantry, gantry.joint_box, 100, seed=1)
    off = unseen.joint_positions + np.radians([0, 0, 0, 0, 0, 0.1])
    evaluation = network_errors(lambda poses: off, unseen).summary()
    assert evaluation.orientation_error.p50 == pytest.approx(np.radians(0.3))
    assert evaluation.orientation_error.max == pytest.approx(np.radians(0.3))


def test_answers_outside_the_limits_are_counted(gantry: Robot) -> None:
    unseen = random_dataset(gantry, gantry.joint_box, 100, seed=1)
    answers = unseen.joint_positions.copy()
    answers[:25, 2] = 3.0
    assert network_errors(lambda poses: answers, unseen).summary().outside_joint_limits == 0.25


def test_summary_of_known_numbers() -> None:
    summary = ErrorSummary.of(np.arange(101.0))
    assert (summary.p50, summary.p95, summary.max) == (50.0, 95.0, 100.0)
