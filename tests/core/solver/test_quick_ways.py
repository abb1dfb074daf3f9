"""What is solved in the kernel, or in a batch, is what the checks one by one give. ROS-free."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.learned_model import write_learned_model

from annik_core.errors import NonFiniteValue, NotUnitQuaternion
from annik_core.kernel import compiled_kernel
from annik_core.model.artifact import Model, load_model
from annik_core.pose import FloatArray, checked_pose, normalise_rows
from annik_core.robots.library import load_robot
from annik_core.robots.task import Task
from annik_core.safety import (
    COMMAND_CHECKS,
    AcceptanceLimits,
    Candidate,
    CommandContext,
    CommandSafety,
    FirstCommandRule,
    IkStatus,
    Measurement,
    Motion,
    surely_accepted,
)
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import IkResult, IkResults, RefinementOptions
from annik_core.solver.search import SearchOptions

ARMS = ("iiwa14", "panda", "puma560", "scara", "ur5e", "xarm6")


LIMITS = AcceptanceLimits()


class OneByOne(IkSolver):
    """Without the kernel's ways to solve one target."""

    _solved_in_kernel = None  # type: ignore[assignment]
    _whole_in_kernel = None  # type: ignore[assignment]


@pytest.fixture(scope="module", params=[*ARMS, "learned", "gantry"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Model:
    if request.param != "learned":
        return load_model(request.param)
    path: Path = tmp_path_factory.mktemp("learned") / "learned.onnx"
    write_learned_model(path)
    return load_model(path)


def targets(model: Model, count: int, seed: int = 0) -> FloatArray:
    """Good ones, and one in two changed: out of reach, unreachable, not unit, not finite."""
    rng = np.random.default_rng(seed)
    poses = model.robot.forward_kinematics.poses(model.robot.joint_box.sample(count, rng))
    for row, pose in enumerate(poses):
        match row % 16:
            case 1:
                pose[rng.integers(7)] = rng.choice([math.nan, math.inf, -math.inf])
            case 3:
                pose[3:] *= rng.uniform(0.9, 1.1)
            case 5:
                pose[3:] *= rng.uniform(0.9992, 1.0008)
            case 7:
                pose[:3] *= rng.uniform(1.0, 3.0)
            case 9:
                pose[3:] *= -1.0
            case 11:
                pose[:3] = rng.uniform(-0.5, 0.5, 3)
            case 13:
                pose[:3] *= 1e300
            case 15:
                pose[3:] = 0.0
    return poses


def check_same(
    found: IkResult, expected: IkResult, tolerance: float = 1e-12, reason: bool = True
) -> None:
    """In all that a user sees; numbers to rounding, which a quaternion off one makes differ."""
    assert found.status is expected.status
    assert found.newton_steps == expected.newton_steps
    numbers = "position_residual", "orientation_residual"
    errors = "expected_position_error", "expected_orientation_error"
    for name in (*numbers, *errors):
        assert getattr(found, name) == pytest.approx(
            getattr(expected, name), rel=1e-6, abs=tolerance, nan_ok=True
        )
    if not expected.accepted:
        assert found.joint_positions is None
        assert not reason or found.reason == expected.reason
        return
    assert found.joint_positions is not None
    assert found.target is not None
    assert not found.joint_positions.flags.writeable
    assert found.joint_positions == pytest.approx(expected.joint_positions, abs=tolerance)
    assert found.target == pytest.approx(expected.target, abs=1e-15)
    assert np.asarray(found.reference) == pytest.approx(expected.reference, abs=1e-12)


def contexts(robot_joints: FloatArray) -> Iterator[tuple[AcceptanceLimits, tuple[object, ...]]]:
    """Limits, and what comes before a target: some that refuse, some that do not."""
    for limits in (
        AcceptanceLimits(),
        AcceptanceLimits(max_position_residual=1e-12),
        AcceptanceLimits(max_joint_step=0.5),
        AcceptanceLimits(max_expected_error=5.2e-5),
    ):
        yield limits, ()
        yield limits, (robot_joints,)
        for safety in (
            CommandSafety(max_joint_velocity=5.0, max_measured_step=1.0),
            CommandSafety(first_command=FirstCommandRule.NEAR, max_first_step=0.7),
        ):
            for interval in (None, 0.1):
                for measured in (None, robot_joints):
                    motion = Motion(safety, interval, Measurement(measured))
                    yield limits, (robot_joints, motion)


def test_one_target(model: Model) -> None:
    solved = 0
    for pose in targets(model, 64):
        expected = OneByOne(model).solve(pose)
        check_same(IkSolver(model).solve(pose), expected)
        solved += expected.accepted
    assert solved > 24


def test_one_target_after_another(model: Model) -> None:
    poses, before = targets(model, 16), model.robot.joint_box.centre
    seen = set()
    for limits, context in contexts(before):
        quick, plain = IkSolver(model, limits), OneByOne(model, limits)
        for pose in poses:
            expected = plain.solve(pose, *context)  # type: ignore[arg-type]
            check_same(quick.solve(pose, *context), expected)  # type: ignore[arg-type]
            seen.add(expected.status)
    assert {IkStatus.SUCCESS, IkStatus.NOT_FINITE} <= seen
    if model.robot.kind == "arm":
        assert {IkStatus.JOINT_STEP_TOO_LARGE, IkStatus.JOINT_VELOCITY_TOO_LARGE} <= seen
        assert IkStatus.FIRST_COMMAND_TOO_FAR in seen


def whole_solvers(
    name: str, limits: AcceptanceLimits = LIMITS, **options: object
) -> tuple[IkSolver, IkSolver]:
    """In the kernel and one by one; ``continuous``: an arm with continuous joints and no box."""
    if compiled_kernel() is None:
        pytest.skip("the kernel is not compiled")
    model = load_model("ur5e" if name == "continuous" else name)
    if name == "continuous":
        text = str(model.robot.definition["urdf"]).replace('"revolute"', '"continuous"')
        base, tip = model.robot.base_frame, model.robot.end_effector_frame
        robot = load_robot(text, base_frame=base, end_effector_frame=tip)
        model = replace(model, robot=robot)
        assert model.robot.turning and model.robot.has_whole_box
    quick, plain = (
        solver(model, limits, SolverMode.WHOLE_ROBOT, search_options=SearchOptions(**options))  # type: ignore[arg-type]
        for solver in (IkSolver, OneByOne)
    )
    assert (quick._whole_in_kernel is None) == limits.limits_expected_errors
    return quick, plain


@pytest.mark.parametrize("name", ["continuous", "panda", "scara", "xarm6"])
def test_a_whole_robot(name: str) -> None:
    """Preferred, continued and all solutions, of good and bad poses, in the box and outside."""
    quick, plain = whole_solvers(name)
    robot, rng = plain.robot, np.random.default_rng(7)
    poses = targets(plain.artifact, 24)
    begin = robot.joint_limits.centre + rng.uniform(-1.5, 1.5, (24, robot.dof))
    poses[::2] = robot.forward_kinematics.poses(begin[::2])
    seen = set()
    for pose, start in zip(poses, begin, strict=True):
        near = start + rng.normal(scale=0.05, size=robot.dof)
        for previous in (None, near, near + 1.0):
            expected = plain.solve(pose, previous)
            check_same(quick.solve(pose, previous), expected)
            seen.add(expected.status)
        for around in (None, near + 7.0):
            found, wanted = quick.solutions(pose, around), plain.solutions(pose, around)
            assert len(found) == len(wanted)
            for one, other in zip(found, wanted, strict=True):
                check_same(one, other)
    assert {IkStatus.SUCCESS, IkStatus.OUTSIDE_WORKSPACE, IkStatus.NOT_FINITE} < seen


def test_a_whole_robot_within_limits() -> None:
    model = load_model("xarm6")
    poses, before, seen = targets(model, 8), model.robot.joint_box.centre, set()
    for limits, context in contexts(before):
        quick, plain = whole_solvers("xarm6", limits)
        for pose in poses:
            expected = plain.solve(pose, *context)  # type: ignore[arg-type]
            check_same(quick.solve(pose, *context), expected)  # type: ignore[arg-type]
            seen.add(expected.status)
        for found, wanted in zip(
            quick.solutions(poses[0]), plain.solutions(poses[0]), strict=True
        ):
            check_same(found, wanted)
    assert {IkStatus.SUCCESS, IkStatus.JOINT_STEP_TOO_LARGE} <= seen


def test_what_a_whole_arm_with_another_task_approaches() -> None:
    quick, plain = whole_solvers("scara", task=Task.POSITION)
    for pose in targets(plain.artifact, 4):
        check_same(quick.solve(pose), plain.solve(pose))
        for found, wanted in zip(quick.solutions(pose), plain.solutions(pose), strict=True):
            check_same(found, wanted)


@pytest.mark.parametrize("threads", [None, 1, 3])
def test_a_batch(model: Model, threads: int | None) -> None:
    """Of more poses than go through the network at once; the solutions to rounding."""
    poses = targets(model, 600, seed=1)
    solver = IkSolver(model)
    for found, pose in zip(solver.solve_batch(poses, threads), poses, strict=True):
        check_same(found, solver.solve(pose), 1e-9, reason=False)


def test_a_batch_within_limits(model: Model) -> None:
    poses = targets(model, 48, seed=2)
    for limits, options in (
        (AcceptanceLimits(max_expected_error=5.2e-5), RefinementOptions()),
        (AcceptanceLimits(max_expected_orientation_error=1.0), RefinementOptions()),
        (AcceptanceLimits(1e-4, 1e-4), RefinementOptions(max_newton_steps=2, tolerance=1e-2)),
    ):
        solver = IkSolver(model, limits, refinement_options=options)
        for found, pose in zip(solver.solve_batch(poses), poses, strict=True):
            check_same(found, solver.solve(pose), 1e-9, reason=False)


def test_a_batch_is_arrays_too() -> None:
    """Refused ones are rows of NaN; no array can be altered."""
    solver = IkSolver.from_file("ur5e")
    poses = solver.robot.forward_kinematics.poses(solver.robot.joint_box.centre[np.newaxis])
    results = solver.solve_batch(np.concatenate([poses, np.full((1, 7), np.nan), poses * 9]))
    assert isinstance(results, IkResults)
    assert results.accepted.tolist() == [True, False, False]
    assert [result.accepted for result in results] == [True, False, False]
    assert np.array_equal(results.joint_positions[0], results[0].joint_positions)
    assert np.isnan(results.joint_positions[1:]).all()
    assert [result.status for result in results[-2:]] == [
        IkStatus.NOT_FINITE,
        IkStatus.NOT_UNIT_QUATERNION,
    ]
    with pytest.raises(IndexError):
        results[3]
    for array in (results.joint_positions, results[0].joint_positions, results.accepted):
        assert array is not None
        assert not array.flags.writeable


def test_a_batch_is_not_the_callers_array(model: Model) -> None:
    poses = targets(model, 4)
    before = poses.copy()
    results = IkSolver(model).solve_batch(poses)
    assert np.array_equal(poses, before, equal_nan=True)
    poses[:] = 0.0
    assert results[0].target is not None
    assert np.array_equal(results[0].target, before[0])


@given(
    st.lists(st.floats(-1.2, 1.2), min_size=7, max_size=7),
    st.sampled_from([0.0, 1e-16, 1e-9, 9.99e-4, 1e-3, 1.001e-3, 0.1, math.nan, math.inf]),
    st.sampled_from([-1.0, 1.0]),
)
def test_rows_that_are_normalised_are_checked_poses(
    numbers: list[float], deviation: float, sign: float
) -> None:
    pose = np.array(numbers)
    norm = np.linalg.norm(pose[3:])
    if norm > 1e-3:
        pose[3:] *= (1.0 + sign * deviation) / norm
    rows = pose[np.newaxis].copy()
    good = bool(normalise_rows(rows)[0])
    try:
        expected = checked_pose(pose)
    except (NonFiniteValue, NotUnitQuaternion):
        assert not good
        return
    if abs(deviation) < 9.9e-4 and norm > 1e-3:
        assert good
    assert rows[0] == pytest.approx(expected if good else pose, abs=1e-15)


@given(st.integers(0, 2**32 - 1))
def test_what_is_surely_accepted_no_check_refuses(seed: int) -> None:
    rng, robot = np.random.default_rng(seed), load_ur5e().robot
    limits = AcceptanceLimits(
        *rng.choice([1e-3, math.inf], 2),
        *(math.inf, *rng.choice([1e-3, math.inf], 2)),
    )
    lower, upper = robot.joint_limits.lower, robot.joint_limits.upper
    rows = rng.uniform(1.02 * lower, 1.02 * upper, (4, robot.dof))
    rows[rng.random(rows.shape) < 0.05] = math.nan
    numbers = rng.choice([0.0, 1e-3, 1.1e-3, math.nan, math.inf], (2, 4, 2))
    converged = rng.random(4) < 0.8
    accepted = surely_accepted(robot, limits, rows, numbers[0], converged, numbers[1])
    for row, sure in enumerate(accepted):
        candidate = Candidate(
            *(robot, np.zeros(7), rows[row], tuple(numbers[0, row])),
            *(0, bool(converged[row])),
        )
        candidate._expected_errors = tuple(numbers[1, row])
        context = CommandContext(limits)
        refusals = [check(candidate, context) for check in COMMAND_CHECKS]
        assert sure == (refusals == [None] * len(refusals))


def load_ur5e(loaded: list[Model] = []) -> Model:  # noqa: B006
    """Once."""
    if not loaded:
        loaded.append(load_model("ur5e"))
    return loaded[0]


def test_another_model_is_solved_with_at_once(model: Model) -> None:
    """The memory of the kernel's way is that of its model."""
    solver = replace(IkSolver(load_ur5e()), artifact=model)
    pose = targets(model, 1)[0]
    check_same(solver.solve(pose), OneByOne(model).solve(pose))
