"""Solutions of an arm whose first and last joint turn without limits. ROS-free."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.continuous_arm import TURNING

from annik_core.pose import FloatArray
from annik_core.safety import (
    AcceptanceLimits,
    CommandSafety,
    FirstCommandRule,
    IkStatus,
    Measurement,
)
from annik_core.serving.ik_server import IkServer
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import IkResult

TURN = 2.0 * math.pi


@pytest.fixture(scope="module")
def solver(continuous_model: Path) -> IkSolver:
    return IkSolver.from_file(continuous_model)


def places(solver: IkSolver, swivel: FloatArray | list[float]) -> FloatArray:
    """Joint positions ``(n, 6)`` in the middle of the box but for the first joint."""
    joints = np.tile(solver.robot.joint_box.centre, (len(swivel), 1))
    joints[:, 0] = swivel
    return joints


def pose_at(solver: IkSolver, swivel: float) -> FloatArray:
    return solver.robot.forward_kinematics.poses(places(solver, [swivel]))[0]


def solution(result: IkResult) -> FloatArray:
    assert result.joint_positions is not None, result.reason
    return result.joint_positions


def check_residuals(solver: IkSolver, result: IkResult) -> None:
    """They are those of exactly what is returned."""
    target = result.target
    assert target is not None
    residuals = solver.robot.forward_kinematics.residuals(solution(result), target)
    assert (result.position_residual, result.orientation_residual) == residuals


def test_a_solution_alone_is_in_the_turn_around_the_box(solver: IkSolver) -> None:
    """Also close to its seam, on both sides of it, and in a batch."""
    robot = solver.robot
    swivel = np.concatenate([np.linspace(-math.pi, math.pi, 81), [3.1415, -3.1415, 3.14159]])
    joints = places(solver, swivel)
    poses = robot.forward_kinematics.poses(joints)
    for expected, pose, of_batch in zip(joints, poses, solver.solve_batch(poses), strict=True):
        result = solver.solve(pose)
        assert np.abs(robot.difference(solution(result), expected)).max() < 1e-5
        assert abs(solution(result)[0]) <= math.pi + 1e-12
        np.testing.assert_allclose(solution(of_batch), solution(result), atol=1e-5)
        check_residuals(solver, result)


@pytest.mark.parametrize("seed_from_previous", [False, True])
@pytest.mark.parametrize("turns", [-3, 0, 2])
def test_solutions_follow_each_other_around_and_around(
    solver: IkSolver, turns: int, seed_from_previous: bool
) -> None:
    """The first joint turns three times either way; no command jumps by a full turn."""
    chosen = replace(solver, seed_from_previous=seed_from_previous)
    for direction in (1.0, -1.0):
        start = places(solver, [TURN * turns])[0]
        previous: IkResult | FloatArray = start
        for step in np.arange(0.0, 3.0 * TURN, 0.2):
            expected = start[0] + direction * step
            result = chosen.solve(pose_at(solver, expected), previous)
            assert solution(result)[0] == pytest.approx(expected, abs=1e-5)
            check_residuals(solver, result)
            previous = result


def test_a_network_alone_is_unwrapped_too(solver: IkSolver) -> None:
    """Whatever turn it has learned; what is not finite is refused."""
    exact = places(solver, [0.3])[0]

    class Network:
        robot = solver.robot
        after_encoding = staticmethod(lambda name: None)
        joint_positions_at = staticmethod(lambda pose: exact + answer)

    alone = replace(solver, artifact=Network(), mode=SolverMode.NETWORK)
    for turned in (0.0, TURN, -5 * TURN):
        answer = np.array([turned, 0, 0, 0, 0, -turned])
        for previous in (0.0, 7.0, -40.0):
            result = alone.solve(pose_at(solver, 0.3), places(solver, [previous])[0])
            assert abs(solution(result)[0] - previous) <= math.pi
            check_residuals(solver, result)
    for broken in (math.nan, math.inf):
        answer = np.full(6, broken)
        assert alone.solve(pose_at(solver, 0.3), exact).status is IkStatus.JOINT_LIMIT


class TestServed:
    """By a server, beside a robot that stands at -3.10 rad while the target is at +3.10."""

    NEAR, FAR = 3.10, 2.5

    @staticmethod
    def server(solver: IkSolver, measured: FloatArray | None, **limits: object) -> IkServer:
        """Of a clock that stands still unless it is set."""
        server = IkServer(
            solver, CommandSafety(**limits), lambda: Measurement(measured), lambda: TestServed.now
        )
        TestServed.now = 0.0
        return server

    now = 0.0

    @pytest.mark.parametrize("turns", [-2, 0, 1])
    @pytest.mark.parametrize("rule", list(FirstCommandRule))
    def test_the_first_command_goes_the_short_way(
        self, solver: IkSolver, turns: int, rule: FirstCommandRule
    ) -> None:
        """Whatever turns the driver counts; 0.083 rad, not 6.2."""
        measured = places(solver, [-3.10 + TURN * turns])[0]
        server = self.server(solver, measured, first_command=rule)
        step = solution(server.solve(pose_at(solver, self.NEAR))) - measured
        assert step[0] == pytest.approx(6.2 - TURN, abs=1e-5)

    def test_the_first_command_is_refused_by_its_real_distance(self, solver: IkSolver) -> None:
        result = self.server(solver, places(solver, [-3.10])[0]).solve(pose_at(solver, self.FAR))
        assert result.status is IkStatus.FIRST_COMMAND_TOO_FAR
        assert "0.68" in result.reason

    def test_without_a_measurement_it_is_in_the_box(self, solver: IkSolver) -> None:
        result = self.server(solver, None).solve(pose_at(solver, self.NEAR))
        assert solution(result)[0] == pytest.approx(self.NEAR, abs=1e-5)

    def test_the_measured_step_is_the_short_way(self, solver: IkSolver) -> None:
        """Also where the driver keeps to one turn, and the commands do not."""
        measured = places(solver, [3.0])[0]
        server = self.server(solver, measured, max_measured_step=0.2, max_joint_velocity=1.0)
        for target in np.arange(3.0, 3.5, 0.1):
            measured[0] = math.remainder(target - 0.05, TURN)
            result = server.solve(pose_at(solver, target))
            assert solution(result)[0] == pytest.approx(target, abs=1e-5)
            TestServed.now += 0.2
        measured[0] = -2.5
        result = server.solve(pose_at(solver, 3.5))
        assert result.status is IkStatus.TOO_FAR_FROM_MEASURED

    def test_the_step_and_the_velocity_are_the_short_way(self, solver: IkSolver) -> None:
        limited = replace(solver, limits=AcceptanceLimits(max_joint_step=0.1))
        server = self.server(limited, places(solver, [-3.10])[0], max_joint_velocity=0.5)
        assert server.solve(pose_at(solver, self.NEAR)).accepted
        TestServed.now += 1.0
        assert server.solve(pose_at(solver, -3.10)).accepted
        TestServed.now += 0.1
        result = server.solve(pose_at(solver, self.NEAR))
        assert result.status is IkStatus.JOINT_VELOCITY_TOO_LARGE
        TestServed.now += 1.0
        result = server.solve(pose_at(solver, self.NEAR - 0.1))
        assert result.status is IkStatus.JOINT_STEP_TOO_LARGE
        assert "0.183" in result.reason

    def test_a_path_is_unwrapped_from_the_robot_on(self, solver: IkSolver) -> None:
        measured = places(solver, [TURN + 3.0])[0]
        swivel = np.arange(3.0, 12.0, 0.1)
        poses = solver.robot.forward_kinematics.poses(places(solver, swivel))
        server = self.server(solver, measured, max_joint_velocity=1.5)
        result = server.solve_path(poses, 0.1, max_poses=100)
        assert result.joint_positions is not None, result.refusal
        np.testing.assert_allclose(result.joint_positions[:, 0], TURN + swivel, atol=1e-5)


def test_a_solution_in_a_part_of_a_turn_is_refused_outside_it(solver: IkSolver) -> None:
    """The last joint may turn by 1 rad either way, in any turn."""
    joints = places(solver, [0.0, 0.0])
    joints[:, TURNING[1]] = 0.9, 1.1
    inside, outside = solver.robot.forward_kinematics.poses(joints)
    previous = joints[0] + TURN
    assert solution(solver.solve(inside, previous))[5] == pytest.approx(0.9 + TURN, abs=1e-5)
    assert solver.solve(outside, previous).status is IkStatus.NOT_CONVERGED
    # The previous solution counts as a start in any turn: here it is the solution.
    previous = joints[0].copy()
    previous[TURNING] += TURN
    result = replace(solver, seed_from_previous=True).solve(inside, previous)
    assert (result.newton_steps, solution(result)[5]) == (0, pytest.approx(0.9 + TURN))
