"""The refinement: bounded, inside the box, without memory, and honest about its end. ROS-free."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.urdf_texts import planar_arm

from annik_core.errors import InvalidValue
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import load_robot, packaged_robots
from annik_core.robots.robot import ForwardKinematics, Linearisation, Robot
from annik_core.solver import refinement
from annik_core.solver.refinement import Refinement
from annik_core.solver.result import RefinementOptions, RefinementResult

ROBOTS = packaged_robots()
FAR_OFF = np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
seeds = st.integers(0, 2**32 - 1)


@dataclass
class Watched:
    """Forward kinematics that keeps where it is linearised."""

    kinematics: ForwardKinematics
    visited: list[FloatArray] = field(default_factory=list)

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        self.visited.append(joint_positions.copy())
        return self.kinematics.linearise(joint_positions, target)


@cache
def robot_named(name: str) -> Robot:
    """Not a fixture: hypothesis would print all of it with a failing example."""
    return load_robot(name)


def refinement_of(robot: Robot, **options: float) -> Refinement:
    return Refinement(robot.forward_kinematics, robot.joint_box, RefinementOptions(**options))


def in_the_box(robot: Robot, rng: np.random.Generator, count: int) -> FloatArray:
    return rng.uniform(robot.joint_box.lower, robot.joint_box.upper, (count, robot.dof))


def any_target(robot: Robot, rng: np.random.Generator) -> FloatArray:
    """Reachable, at the edge of what is, or far off; seldom one with the right orientation."""
    kind = rng.integers(4)
    if kind == 0:
        return robot.forward_kinematics.poses(in_the_box(robot, rng, 1))[0]
    if kind == 1:
        limits = robot.joint_limits
        q = rng.choice([0.0, 0.5, 1.0], (1, robot.dof)) * (limits.upper - limits.lower)
        return robot.forward_kinematics.poses(limits.lower + q)[0]
    quaternion = rng.normal(size=4)
    position = rng.normal(scale=10.0 ** rng.uniform(-2, 4), size=3)
    return np.concatenate([position, quaternion / np.linalg.norm(quaternion)])


def check_promises(
    robot: Robot, target: FloatArray, result: RefinementResult, tolerance: float
) -> None:
    """What holds of every result, by the poses alone."""
    box = robot.joint_box
    assert box.contains(result.joint_positions)
    locked = box.lower == box.upper
    assert np.array_equal(result.joint_positions[locked], box.lower[locked])
    achieved = robot.forward_kinematics.poses(result.joint_positions[None])[0]
    position, orientation = pose_distance(target, achieved)
    assert result.position_residual == pytest.approx(position, rel=1e-9, abs=1e-12)
    assert result.orientation_residual == pytest.approx(orientation, abs=1e-7)
    within = result.position_residual <= tolerance and result.orientation_residual <= tolerance
    assert result.converged == within


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=60)
@given(seed=seeds, steps=st.integers(0, 30), tolerance=st.sampled_from([5e-7, 1e-4, 0.05]))
def test_whatever_is_asked_the_promises_hold(
    name: str, seed: int, steps: int, tolerance: float
) -> None:
    """The box, the locked joints, the residuals, the number of steps: from any start to any pose.

    Starts may be outside the box, targets out of reach.
    """
    robot, rng = robot_named(name), np.random.default_rng(seed)
    target = any_target(robot, rng)
    start = in_the_box(robot, rng, 1)[0] + rng.normal(
        scale=rng.choice([0, 0.1, 10]), size=robot.dof
    )
    given_start = start.copy()
    watched = Watched(robot.forward_kinematics)
    options = RefinementOptions(max_newton_steps=steps, tolerance=tolerance)
    result = Refinement(watched, robot.joint_box, options).refine(start, target)
    check_promises(robot, target, result, tolerance)
    assert 0 <= result.newton_steps <= steps
    # One a step and one a search, of which there are three at most; three a reflection, of which
    # there are two; one to compare where each of these ended.
    assert len(watched.visited) <= steps + 3 + 2 * 3 + 2
    # Only the finite differences of a reflection look a little over the edge.
    edge = 1.0001e-4
    lower, upper = robot.joint_box.lower - edge, robot.joint_box.upper + edge
    assert all(((q >= lower) & (q <= upper)).all() for q in watched.visited)
    assert np.array_equal(start, given_start)
    assert not np.shares_memory(start, result.joint_positions)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_same_question_has_the_same_answer(name: str) -> None:
    """Bit for bit, whatever was asked in between, and of another object too."""
    robot, rng = robot_named(name), np.random.default_rng(3)
    one = refinement_of(robot)
    questions = [(in_the_box(robot, rng, 1)[0], any_target(robot, rng)) for _ in range(20)]
    first = [one.refine(*question) for question in questions]
    order = rng.permutation(20)
    other = refinement_of(load_robot(name))
    for again in (one, other):
        for number in order:
            answer = again.refine(*questions[number])
            assert answer.joint_positions.tobytes() == first[number].joint_positions.tobytes()
            assert answer[1:] == first[number][1:]


@pytest.mark.parametrize("name", ROBOTS)
def test_near_starts_converge(name: str) -> None:
    """At least 99 of 100, from 0.1 rad off, within the 10 steps that are usual."""
    robot, rng = robot_named(name), np.random.default_rng(4)
    box = robot.joint_box
    goals = in_the_box(robot, rng, 300)
    off = rng.normal(size=goals.shape) * (box.upper > box.lower)
    starts = goals + 0.1 * off / np.linalg.norm(off, axis=1, keepdims=True)
    one = refinement_of(robot)
    targets = robot.forward_kinematics.poses(goals)
    results = [one.refine(start, target) for start, target in zip(starts, targets, strict=True)]
    assert sum(result.converged for result in results) >= 297
    for target, result in zip(targets, results, strict=True):
        check_promises(robot, target, result, 5e-7)
    positions = np.array([r.joint_positions for r in results if r.converged])
    distances = pose_distance(
        targets[[r.converged for r in results]], robot.forward_kinematics.poses(positions)
    )
    assert np.max(distances) <= 5e-7 + 1e-9


@pytest.mark.parametrize("name", ROBOTS)
def test_the_solution_itself_takes_no_step(name: str) -> None:
    robot = robot_named(name)
    q = robot.joint_box.centre
    result = refinement_of(robot).refine(q, robot.forward_kinematics.poses(q[None])[0])
    assert (result.newton_steps, result.converged) == (0, True)
    assert np.array_equal(result.joint_positions, q)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("steps", [0, 1, 10, 1000])
def test_an_unreachable_target_is_told(name: str, steps: int) -> None:
    robot = robot_named(name)
    result = refinement_of(robot, max_newton_steps=steps).refine(robot.joint_box.centre, FAR_OFF)
    assert not result.converged
    assert result.newton_steps <= steps
    assert 3.0 < result.position_residual < 10.0
    assert 0.0 <= result.orientation_residual <= math.pi + 1e-9
    check_promises(robot, FAR_OFF, result, 5e-7)


def test_hopeless_targets_cost_few_steps() -> None:
    """A search that comes no nearer ends, however many steps it might take."""
    robot = robot_named("ur5e")
    result = refinement_of(robot, max_newton_steps=1000).refine(robot.joint_box.centre, FAR_OFF)
    assert result.newton_steps < 50


@pytest.mark.parametrize("distance", [1e10, 1e100, 1e200, 1e300])
def test_absurd_targets_leave_no_nan(distance: float) -> None:
    robot = robot_named("ur5e")
    target = FAR_OFF.copy()
    target[0] = distance
    result = refinement_of(robot).refine(robot.joint_box.centre, target)
    assert not result.converged
    assert robot.joint_box.contains(result.joint_positions)


def test_at_a_singularity_far_from_the_target_a_step_is_short() -> None:
    """Without damping the straight elbow would be bent by thousands of turns."""
    robot = load_robot(planar_arm())
    start = np.array([0.0, 1e-4, 0.0])
    target = robot.forward_kinematics.poses(start[None])[0]
    target[0] -= 0.5
    watched = Watched(robot.forward_kinematics)
    options = RefinementOptions(max_newton_steps=1)
    Refinement(watched, robot.joint_box, options).refine(start, target)
    assert 0.0 < np.linalg.norm(watched.visited[1] - watched.visited[0]) < 0.5


def test_no_steps_only_measures() -> None:
    """At the start, moved into the box."""
    robot = robot_named("panda")
    start = robot.joint_box.upper + np.array([0.0, 1.0, 2.0, -0.1, 0.0, 0.0, -0.2])
    watched = Watched(robot.forward_kinematics)
    options = RefinementOptions(max_newton_steps=0)
    result = Refinement(watched, robot.joint_box, options).refine(start, FAR_OFF)
    expected = np.clip(start, robot.joint_box.lower, robot.joint_box.upper)
    assert np.array_equal(result.joint_positions, expected)
    assert result.newton_steps == 0
    assert len(watched.visited) == 1


def test_a_tighter_tolerance_is_met() -> None:
    """Convergence is quadratic: a million times nearer costs a step or two."""
    robot = robot_named("ur5e")
    goal = robot.joint_box.centre
    target = robot.forward_kinematics.poses(goal[None])[0]
    steps = []
    for tolerance in (1e-4, 1e-10):
        result = refinement_of(robot, tolerance=tolerance).refine(goal + 0.05, target)
        assert result.converged
        assert max(result.position_residual, result.orientation_residual) <= tolerance
        steps.append(result.newton_steps)
    assert steps[1] <= steps[0] + 2


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara"])
def test_a_solution_on_the_walls_of_the_box_is_found(name: str) -> None:
    """Where the way there would lead outside, joints stop at their bounds."""
    robot, rng = robot_named(name), np.random.default_rng(5)
    box = robot.joint_box
    one = refinement_of(robot, max_newton_steps=50)
    converged = 0
    for _ in range(100):
        goal = in_the_box(robot, rng, 1)[0]
        joints = rng.choice(robot.dof, 2, replace=False)
        goal[joints] = np.where(rng.random(2) < 0.5, box.lower[joints], box.upper[joints])
        start = goal + rng.uniform(-0.1, 0.1, robot.dof)
        converged += one.refine(start, robot.forward_kinematics.poses(goal[None])[0]).converged
    assert converged >= 95


@pytest.mark.parametrize("elbow", [1.0, 1.5])
@pytest.mark.parametrize("start", [-0.3, -0.5])
def test_a_search_that_began_beyond_the_fold_comes_back(
    monkeypatch: pytest.MonkeyPatch, elbow: float, start: float
) -> None:
    """The mirrored elbow is outside the box: without the reflection there is no way."""
    robot = load_robot(planar_arm(), joint_box={"elbow": [-0.5, 3.0]})
    target = robot.forward_kinematics.poses(np.array([[0.2, elbow, 0.3]]))[0]
    begin = np.array([0.2 + elbow, start, 0.3 + elbow])
    result = refinement_of(robot).refine(begin, target)
    assert result.converged
    assert result.joint_positions == pytest.approx([0.2, elbow, 0.3], abs=1e-5)
    monkeypatch.setattr(refinement, "reflected_across_singularity", lambda jacobian, q, free: q)
    stuck = refinement_of(robot).refine(begin, target)
    assert not stuck.converged
    assert stuck.joint_positions[1] == -0.5


def test_what_fails_every_way_is_reported_as_the_first_search_left_it() -> None:
    """Without the detour; the steps of all searches count."""
    robot = load_robot(planar_arm(), joint_box={"elbow": [0.5, 2.0]})
    watched = Watched(robot.forward_kinematics)
    options = RefinementOptions(max_newton_steps=100)
    start = robot.joint_box.centre
    result = Refinement(watched, robot.joint_box, options).refine(start, FAR_OFF)
    # Each of three searches measures once more than it steps, two starts were compared, and each
    # of the two reflections took three Jacobians.
    ends = [n for n, q in enumerate(watched.visited) if np.array_equal(q, result.joint_positions)]
    assert result.newton_steps == len(watched.visited) - 3 - 2 - 2 * 3
    assert ends[0] < result.newton_steps
    short = RefinementOptions(max_newton_steps=ends[0])
    alone = Refinement(robot.forward_kinematics, robot.joint_box, short).refine(start, FAR_OFF)
    assert np.array_equal(alone.joint_positions, result.joint_positions)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("max_newton_steps", -1),
        ("max_newton_steps", 1001),
        ("max_newton_steps", math.nan),
        ("tolerance", 0.0),
        ("tolerance", -1e-6),
        ("tolerance", 1e-13),
        ("tolerance", 1.5),
        ("tolerance", math.nan),
        ("tolerance", math.inf),
    ],
)
def test_an_option_out_of_range_is_named(option: str, value: float) -> None:
    with pytest.raises(InvalidValue) as caught:
        RefinementOptions(**{option: value})
    assert caught.value.name == option
    assert " to " in caught.value.allowed


@pytest.mark.parametrize(("steps", "tolerance"), [(0, 1e-12), (1000, 1.0)])
def test_options_at_the_ends_of_their_ranges(steps: int, tolerance: float) -> None:
    options = RefinementOptions(steps, tolerance)
    assert (options.max_newton_steps, options.tolerance) == (steps, tolerance)


def test_a_start_that_is_not_finite_is_not_searched_from() -> None:
    robot = robot_named("ur5e")
    start = np.full(6, np.nan)
    target = robot.forward_kinematics.poses(robot.joint_box.centre[np.newaxis])[0]
    result = refinement_of(robot).refine(start, target)
    assert not result.converged
    assert result.newton_steps == 0


@pytest.mark.parametrize("nearer", ["from the start", "from the end"])
def test_of_two_starts_beyond_singularities_the_nearer_to_the_target_is_tried_first(
    monkeypatch: pytest.MonkeyPatch, nearer: str
) -> None:
    robot = load_robot(planar_arm())
    begin, end = np.array([0.1, 0.5, 0.0]), np.array([0.2, 0.1, 0.0])
    goal = np.array([0.1, -0.6, 0.0])
    near, far = goal + 0.1, goal + 0.9
    beyond = (near, far) if nearer == "from the start" else (far, near)
    target = robot.forward_kinematics.poses(goal[np.newaxis])[0]
    searched: list[FloatArray] = []

    def reflected(jacobian: object, positions: FloatArray, free: object) -> FloatArray:
        return beyond[0] if np.array_equal(positions, begin) else beyond[1]

    def search(
        self: Refinement, start: FloatArray, target: FloatArray, most: int
    ) -> RefinementResult:
        searched.append(start)
        return RefinementResult(end, 1.0, 1.0, 1, False)

    monkeypatch.setattr(refinement, "reflected_across_singularity", reflected)
    monkeypatch.setattr(Refinement, "search", search)
    result = refinement_of(robot).refine(begin, target)
    assert not result.converged
    assert result.newton_steps == 3
    np.testing.assert_array_equal(searched, [begin, near, far])
