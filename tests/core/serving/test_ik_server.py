"""Serving targets one after the other. Needs no ROS."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from annik_core.errors import AnnikError
from annik_core.installation import default_model_path
from annik_core.model.errors import ModelError
from annik_core.pose import pose_from_roll_pitch_yaw
from annik_core.safety import AcceptanceLimits, IkStatus
from annik_core.serving.ik_server import IkServer
from annik_core.solver.ik_solver import IkSolver

NEAR = pose_from_roll_pitch_yaw([0.30, 0.4, 0.6], [0.5, 0.4, 0.3])
FAR = pose_from_roll_pitch_yaw([0.40, 0.4, 0.6], [0.5, 0.4, 0.3])


@pytest.fixture
def server() -> IkServer:
    """The packaged model, with a clock that advances by one second at every look."""
    ticks: Iterator[int] = count()
    return IkServer(IkSolver.from_file(default_model_path()), clock=lambda: float(next(ticks)))


def test_a_good_target_gives_a_command_with_the_checked_target(server: IkServer) -> None:
    """The target's quaternion is normalised, the joint positions are the result's own."""
    pose = NEAR.copy()
    pose[3:] *= 1.0005
    answer = server.solve(pose)
    assert answer.accepted
    assert answer.target is not None
    np.testing.assert_allclose(answer.target, NEAR, rtol=1e-12)


@pytest.mark.parametrize("frame_id", ["", "base_link"])
def test_the_base_frame_may_be_named_or_left_out(server: IkServer, frame_id: str) -> None:
    """Both mean the same."""
    assert server.solve(NEAR, frame_id).accepted


@pytest.mark.parametrize("frame_id", ["tool0", "/base_link", "base_link ", "BASE_LINK"])
def test_another_frame_is_refused_naming_both(server: IkServer, frame_id: str) -> None:
    """Nothing is transformed, and nothing is guessed."""
    answer = server.solve(NEAR, frame_id)
    assert answer.accepted is False
    assert answer.status is IkStatus.WRONG_FRAME
    assert repr(frame_id) in answer.reason
    assert "'base_link'" in answer.reason


def test_the_joint_step_is_measured_from_the_last_accepted_command(server: IkServer) -> None:
    """A refused target leaves no trace."""
    server.solver = replace(server.solver, limits=AcceptanceLimits(max_joint_step=0.01))
    assert server.solve(NEAR).accepted
    assert server.solve(FAR).status is IkStatus.JOINT_STEP_TOO_LARGE
    assert server.solve(FAR).status is IkStatus.JOINT_STEP_TOO_LARGE
    assert server.solve(NEAR).accepted


def test_limits_count_from_the_next_target_on(server: IkServer) -> None:
    """The model stays."""
    artifact = server.solver.artifact
    server.solver = replace(server.solver, limits=AcceptanceLimits(max_position_residual=1e-15))
    assert server.solve(NEAR).status is IkStatus.RESIDUAL_TOO_LARGE
    server.solver = replace(server.solver, limits=AcceptanceLimits())
    assert server.solve(NEAR).accepted
    assert server.solver.artifact is artifact


def test_answers_are_counted_and_timed(server: IkServer) -> None:
    """By the clock that it was given."""
    server.solve(NEAR)
    server.solve(np.full(7, math.nan))
    server.solve(NEAR, "camera")
    summary = server.end_period()
    assert summary.outcomes.received == 3
    assert summary.outcomes.refused_by_reason == {"not finite": 1, "wrong frame": 1}
    assert summary.solve_time.p50 == 1.0


def test_an_error_of_the_solver_is_a_refusal(
    server: IkServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One target that nobody foresaw does not end the service of the others."""

    def fail(*_: object) -> None:
        raise AnnikError("the unforeseen")

    with monkeypatch.context() as patch:
        patch.setattr(IkSolver, "solve", fail)
        result = server.solve(NEAR)
    assert result.status is IkStatus.SOLVER_FAILED
    assert result.reason == "the unforeseen"
    assert server.solve(NEAR).accepted


def test_a_model_that_is_refused_changes_nothing(server: IkServer, tmp_path: Path) -> None:
    """Not the model, and not what is remembered of the last command."""
    before = server.solver
    spoiled = tmp_path / "model.onnx"
    spoiled.write_bytes(default_model_path().read_bytes()[:1000])
    for path in (spoiled, tmp_path / "missing.onnx"):
        with pytest.raises(ModelError):
            server.load_model(path)
    assert server.solver is before


def test_a_model_of_the_same_robot_takes_over_with_the_same_limits(server: IkServer) -> None:
    """And the joint step is still measured from the last command."""
    server.solver = replace(server.solver, limits=AcceptanceLimits(max_joint_step=0.01))
    assert server.solve(NEAR).accepted
    before = server.solver.artifact
    server.load_model(default_model_path())
    assert server.solver.artifact is not before
    assert server.solve(FAR).status is IkStatus.JOINT_STEP_TOO_LARGE
