"""What the page shows of a robot, without a browser."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from annik_core import IkSolver, IkStatus, SolverMode, load_model
from annik_core.robots.library import load_robot, robot_from_definition
from annik_view import shapes
from annik_view.skeleton import Skeleton
from annik_view.solvers import WithoutNetwork, nominal_of, solver_for, solver_of
from annik_view.state import PATHS, TRAIL, Examples, ViewState


@pytest.fixture(scope="module")
def solver() -> IkSolver:
    return solver_of("ur5e")


@pytest.fixture
def state(solver: IkSolver) -> ViewState:
    return ViewState(solver)


def shifted(state: ViewState, *by: float) -> np.ndarray:
    pose = state.target.copy()
    pose[:3] += by
    return pose


def test_the_arm_goes_to_the_target(state: ViewState) -> None:
    goal = shifted(state, 0.03, -0.02, 0.04)
    before = state.joint_positions
    answer = state.move_target(goal)
    assert answer.accepted
    assert state.joint_positions is answer.joint_positions
    assert np.abs(state.joint_positions - before).max() < 0.5
    np.testing.assert_allclose(state.achieved[:3], goal[:3], atol=1e-6)
    np.testing.assert_allclose(state.posture().points[-1], goal[:3], atol=1e-6)
    assert state.solve_time > 0.0
    assert dict(state.readout())["answer"] == "accepted"


def test_a_refused_target_leaves_the_arm_and_says_why(state: ViewState) -> None:
    before = state.joint_positions
    answer = state.move_target(shifted(state, 5.0, 0.0, 0.0))
    assert state.refused
    assert answer.status is IkStatus.OUTSIDE_WORKSPACE
    assert state.joint_positions is before
    assert dict(state.readout())["reason"] == answer.reason


def test_another_solution_is_taken_and_kept_while_the_target_moves(state: ViewState) -> None:
    state.find_solutions()
    assert len(state.solutions) > 4
    for solution in state.solutions:
        reached = state.robot.forward_kinematics.poses(solution.joint_positions[np.newaxis])[0]
        np.testing.assert_allclose(reached[:3], state.target[:3], atol=1e-5)
    chosen = state.solutions[3].joint_positions
    state.choose(3)
    np.testing.assert_array_equal(state.joint_positions, chosen)
    assert state.move_target(shifted(state, 0.001, 0.0, 0.0)).accepted
    assert np.abs(state.joint_positions - chosen).max() < 0.1
    assert state.solutions == []


def test_sliders_move_the_target(state: ViewState) -> None:
    positions = state.joint_positions + 0.1
    state.show_joints(positions)
    reached = state.robot.forward_kinematics.poses(positions[np.newaxis])[0]
    np.testing.assert_array_equal(state.target, reached)
    assert not state.refused


@pytest.mark.parametrize("name", PATHS)
def test_a_path_begins_and_ends_at_the_target(state: ViewState, name: str) -> None:
    start = state.target.copy()
    state.start_path(name)
    targets = []
    while (target := state.next_target()) is not None:
        assert state.move_target(target).accepted
        targets.append(target)
    np.testing.assert_allclose(targets[0], start, atol=1e-12)
    np.testing.assert_allclose(targets[-1], start, atol=1e-12)
    assert len(state.target_trail) > 50


def test_trails_are_bounded_and_do_not_repeat(state: ViewState) -> None:
    goal = state.target.copy()
    for angle in np.linspace(0.0, 40.0 * math.pi, 3000):
        state.move_target(goal + 0.05 * np.array([0, 1, 0, 0, 0, 0, 0]) * math.sin(angle))
    assert len(state.target_trail) == len(state.achieved_trail) == TRAIL
    for _ in range(5):
        state.move_target(state.target)
    assert not np.array_equal(state.target_trail[-1], state.target_trail[-2])
    state.clear_trails()
    assert not state.target_trail


def test_what_follows_is_not_moved_by_an_answer(solver: IkSolver) -> None:
    state = ViewState(solver, follows=True)
    before = state.joint_positions
    assert state.move_target(shifted(state, 0.01, 0.0, 0.0)).accepted
    assert state.joint_positions is before
    state.measured(before + 0.2)
    np.testing.assert_array_equal(state.joint_positions, before + 0.2)


@pytest.mark.parametrize("name", ["gantry", "ur5e", "panda", "scara"])
def test_every_kind_of_robot_is_drawn_to_its_end_effector(name: str) -> None:
    skeleton = Skeleton(load_robot(name))
    robot = skeleton.robot
    for share in (0.2, 0.7):
        box = robot.joint_box
        positions = box.lower + share * (box.upper - box.lower)
        posture = skeleton.posture(positions)
        pose = robot.forward_kinematics.poses(positions[np.newaxis])[0]
        np.testing.assert_allclose(posture.points[-1], pose[:3], atol=1e-12)
        assert len(posture.axes) == len(posture.points) - 2
        np.testing.assert_allclose(np.linalg.norm(posture.axes, axis=1), 1.0)
        assert np.isfinite(shapes.whole(posture, skeleton.reach).vertices).all()
    assert 0.1 < skeleton.reach < 5.0


def test_ranges_of_joints_end_at_their_limits() -> None:
    """Of each joint of Panda a hand, which turns with it, and an arc between the limits."""
    skeleton = Skeleton(load_robot("panda"))
    limits, start = skeleton.robot.joint_limits, skeleton.robot.joint_box.centre
    segments = skeleton.ranges(start).reshape(skeleton.robot.dof, -1, 2, 3)
    for joint, drawn in enumerate(segments):
        for limit, end in ((limits.lower, drawn[0, 0]), (limits.upper, drawn[-2, 1])):
            there = start.copy()
            there[joint] = limit[joint]
            hand = skeleton.ranges(there).reshape(segments.shape)[joint, -1]
            np.testing.assert_allclose(hand, [drawn[-1, 0], end], atol=1e-12)
        assert np.ptp(np.linalg.norm(drawn[:, 1] - drawn[-1, 0], axis=1)) < 1e-12


@pytest.mark.parametrize("name", ["gantry", "ur5e"])
def test_joints_that_can_make_a_whole_turn_have_no_range(name: str) -> None:
    skeleton = Skeleton(load_robot(name))
    assert not len(skeleton.ranges(skeleton.robot.joint_box.centre))


def test_a_tube_is_closed_and_has_its_volume() -> None:
    start, end = np.array([0.1, 0.2, 0.3]), np.array([0.4, -0.3, 0.9])
    mesh = shapes.tube(start, end, 0.05, 0.02)
    corners = mesh.vertices.astype(float)[mesh.faces.astype(int)]
    # By the divergence theorem: right only if every triangle faces outwards.
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    length = np.linalg.norm(end - start)
    cone = math.pi * length / 3.0 * (0.05**2 + 0.05 * 0.02 + 0.02**2)
    assert volume == pytest.approx(cone, rel=0.02)


def test_an_arm_without_a_model_is_solved_too() -> None:
    robot = load_robot("ur5e")
    state = ViewState(IkSolver(WithoutNetwork(robot), mode=SolverMode.WHOLE_ROBOT))
    assert state.move_target(shifted(state, 0.02, 0.0, 0.0)).accepted
    state.find_solutions()
    assert len(state.solutions) > 4


def test_a_calibrated_arm_is_compared_with_the_nominal_one() -> None:
    nominal = load_robot("ur5e")
    placements = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (nominal.dof + 1, 1))
    placements[2, 0] = 1e-3
    corrections = {"placements": placements.tolist()}
    robot = robot_from_definition({**nominal.definition, "corrections": corrections}, "test")
    model = dataclasses.replace(load_model("ur5e"), robot=robot)
    state = ViewState(IkSolver(model, mode=SolverMode.WHOLE_ROBOT))
    assert state.difference == pytest.approx(1e-3, rel=1e-6)
    assert state.suited_magnification == 50.0
    magnified = state.magnified_nominal(50.0)
    away = np.linalg.norm(magnified.points[-1] - state.achieved[:3])
    assert away == pytest.approx(0.05, rel=1e-6)
    assert "nominal arm away by" in dict(state.readout())
    assert nominal_of(nominal) is None


def test_the_robot_goes_to_an_example(solver: IkSolver) -> None:
    rows = solver.robot.joint_box.sample(5, np.random.default_rng(0))
    positions = solver.robot.forward_kinematics.poses(rows)[:, :3]
    state = ViewState(solver, examples=Examples(rows, positions))
    state.show_example(3)
    np.testing.assert_allclose(state.achieved[:3], positions[3], atol=1e-9)
    assert ("examples", "5") in state.readout()


def test_the_page_says_how_many_examples_are_measured(solver: IkSolver) -> None:
    rows = solver.robot.joint_box.sample(5, np.random.default_rng(0))
    state = ViewState(solver, follows=True, examples=Examples(rows, rows[:, :3]))
    assert state.examples is not None
    state.examples.measured = frozenset({1, 2})
    assert ("examples", "5, 2 measured") in state.readout()


def test_the_packaged_gantry_needs_no_model_to_be_named() -> None:
    assert solver_for(load_robot("gantry")).robot.definition == load_robot("gantry").definition
