"""What a learned model states of its own error, and what is refused for it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.learned_model import EXPECTED_ANGLE, EXPECTED_ERROR, write_learned_model

from annik_core.errors import InvalidValue
from annik_core.model.artifact import load_model
from annik_core.safety import (
    AcceptanceLimits,
    Candidate,
    CommandContext,
    IkStatus,
    check_expected_errors,
)
from annik_core.solver.ik_solver import IkSolver


@pytest.fixture(scope="module")
def solver(tmp_path_factory: pytest.TempPathFactory) -> IkSolver:
    path = tmp_path_factory.mktemp("learned") / "learned.onnx"
    write_learned_model(path)
    return IkSolver(load_model(path))


def test_the_answer_is_for_the_learned_robot_and_states_its_error(solver: IkSolver) -> None:
    robot = solver.robot
    for positions in robot.joint_box.sample(20, np.random.default_rng(0)):
        result = solver.solve(robot.forward_kinematics.poses(positions[np.newaxis])[0])
        assert result.status is IkStatus.SUCCESS
        assert result.joint_positions is not None
        assert robot.error_bound is not None
        expected = robot.error_bound.at(result.joint_positions)
        stated = result.expected_position_error, result.expected_orientation_error
        assert stated == expected
        assert expected[0] / EXPECTED_ERROR == pytest.approx(expected[1] / EXPECTED_ANGLE)
        scaled = result.joint_positions[0] / robot.joint_box.upper[0]
        assert expected[0] == pytest.approx(EXPECTED_ERROR * math.exp(scaled**2))


def test_beyond_the_limit_it_is_refused_and_at_the_limit_not(solver: IkSolver) -> None:
    """The bound is the least at the middle of the box, and grows by e to its face."""
    robot = solver.robot
    middle = robot.joint_box.centre
    edge = middle.copy()
    edge[0] = 0.99 * robot.joint_box.upper[0]
    near, far = robot.forward_kinematics.poses(np.array([middle, edge]))
    for limits, refused in (
        (AcceptanceLimits(max_expected_error=2 * EXPECTED_ERROR), ["error", "0.133"]),
        (
            AcceptanceLimits(max_expected_orientation_error=2 * EXPECTED_ANGLE),
            ["orientation error", "0.0152"],
        ),
    ):
        limited = replace(solver, limits=limits)
        assert limited.solve(near).accepted
        result = limited.solve(far)
        assert result.status is IkStatus.EXPECTED_ERROR_TOO_LARGE
        assert result.joint_positions is None
        assert all(word in result.reason for word in refused)
        assert math.isfinite(result.position_residual)


def test_outside_the_box_it_states_what_it_states_at_its_face(solver: IkSolver) -> None:
    bound = solver.robot.error_bound
    assert bound is not None
    upper = solver.robot.joint_box.upper
    assert bound.at(upper + 10.0) == bound.at(upper)


def test_of_a_model_that_was_not_calibrated_it_is_unknown() -> None:
    artifact = load_model("ur5e")
    centre = artifact.robot.joint_box.centre[np.newaxis]
    target = artifact.robot.forward_kinematics.poses(centre)[0]
    result = IkSolver(artifact).solve(target)
    assert result.accepted
    assert math.isnan(result.expected_position_error)
    limited = IkSolver(artifact, AcceptanceLimits(max_expected_error=1.0)).solve(target)
    assert limited.status is IkStatus.EXPECTED_ERROR_TOO_LARGE
    assert "unknown" in limited.reason


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
@pytest.mark.parametrize("name", ["max_expected_error", "max_expected_orientation_error"])
def test_a_limit_is_positive(name: str, value: float) -> None:
    with pytest.raises(InvalidValue) as caught:
        AcceptanceLimits(**{name: value})
    assert caught.value.name == name


def test_no_limit_accepts_what_is_unknown() -> None:
    robot = load_model("ur5e").robot
    candidate = Candidate(robot, np.zeros(7), robot.joint_box.centre)
    assert all(map(math.isnan, candidate.expected_errors()))
    assert check_expected_errors(candidate, CommandContext(AcceptanceLimits())) is None


def test_a_learned_robot_has_the_nominal_hash_of_the_one_described(solver: IkSolver) -> None:
    nominal = load_model("ur5e").robot
    assert solver.robot.definition_hash != nominal.definition_hash
    assert solver.robot.nominal_hash == nominal.nominal_hash == nominal.definition_hash
