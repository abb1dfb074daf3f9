"""The checks on targets and commands, one by one and in order. Needs no ROS."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.errors import InvalidValue
from annik_core.installation import default_model_path
from annik_core.pose import POSE_FIELDS, FloatArray, pose_from_roll_pitch_yaw
from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.library import load_robot
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
    check_age,
    check_joint_velocity,
    check_path_length,
    check_residuals,
    check_workspace_box,
)
from annik_core.serving.ik_server import IkServer
from annik_core.solver import ik_solver
from annik_core.solver.ik_solver import IkSolver

POSES = np.array(
    [pose_from_roll_pitch_yaw([x, 0.4, 0.6], [0.5, 0.4, 0.3]) for x in np.linspace(0.3, 0.4, 11)]
)
UNREACHABLE = pose_from_roll_pitch_yaw([2.0, 0.4, 0.6], [0.5, 0.4, 0.3])


class Bench:
    """A server whose clock and whose robot are set by hand."""

    def __init__(self, safety: CommandSafety) -> None:
        self.now = 100.0
        self.measured: FloatArray | None = None
        self.fault: str | None = None
        self.server = IkServer(
            IkSolver.from_file(default_model_path()),
            safety,
            measure=lambda: Measurement(self.measured, self.fault),
            clock=lambda: self.now,
        )

    def joint_positions(self, pose: FloatArray) -> FloatArray:
        """Where the robot is when it is at a pose."""
        found = self.server.solver.solve(pose).joint_positions
        assert found is not None
        return found


@pytest.fixture
def bench() -> Iterator[Bench]:
    """With the default limits."""
    yield Bench(CommandSafety())


class TestEnds:
    """What is at its limit is allowed, and the next number is not; NaN is beyond every limit."""

    @pytest.mark.parametrize("kind", [0, 1], ids=["position", "orientation"])
    def test_of_the_residuals(self, kind: int) -> None:
        limits = (1e-3, 2e-3)
        context = CommandContext(AcceptanceLimits(*limits))
        beyond = math.nextafter(limits[kind], 1.0)
        for residual, allowed in ((limits[kind], True), (beyond, False), (math.nan, False)):
            residuals = (residual, 0.0) if kind == 0 else (0.0, residual)
            candidate = Candidate(load_robot("scara"), POSES[0], np.zeros(4), residuals)
            refusal = check_residuals(candidate, context)
            assert (refusal is None) == allowed
            assert refusal is None or refusal.status is IkStatus.RESIDUAL_TOO_LARGE

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_of_the_workspace_box(self, axis: int) -> None:
        safety = CommandSafety(workspace_box_lower=(-1.0,) * 3, workspace_box_upper=(2.0,) * 3)
        pose = [0.0] * 6 + [1.0]
        for value, away in ((-1.0, -math.inf), (2.0, math.inf)):
            pose[axis] = value
            assert check_workspace_box(pose, safety) is None
            pose[axis] = math.nextafter(value, away)
            assert check_workspace_box(pose, safety) is not None

    def test_of_a_path_length_and_an_age(self) -> None:
        assert [check_path_length(count, 10) is None for count in (0, 1, 10, 11)] == [
            *(False, True),
            *(True, False),
        ]
        safety = CommandSafety(max_target_age=0.1)
        beyond = math.nextafter(0.1, 1.0)
        ages = (0.1, -0.1, beyond, -beyond, math.nan)
        allowed = [check_age(age, safety) is None for age in ages]
        assert allowed == [True, True, False, False, False]


class TestOrder:
    """One tuple of checks on a command, in the order of the statuses, each run once."""

    @staticmethod
    def failing() -> tuple[Candidate, CommandContext]:
        """What every check refuses."""
        robot = load_robot("scara")
        upper = robot.joint_limits.upper
        candidate = Candidate(robot, POSES[0], upper + 1.0, (1.0, 1.0), converged=False)
        candidate.branch_end = "it ends"
        limits = AcceptanceLimits(1e-3, 1e-3, 1e-3, max_expected_error=1e-3)
        safety = CommandSafety(max_joint_velocity=1e-3, max_measured_step=1e-3)
        return candidate, CommandContext(limits, upper, Motion(safety, 0.1, Measurement(upper)))

    def test_is_that_of_the_statuses(self) -> None:
        candidate, context = self.failing()
        motion = context.motion
        assert motion is not None
        first = context._replace(motion=motion._replace(interval=None))
        statuses = []
        for check in COMMAND_CHECKS:
            refusals = [check(candidate, context), check(candidate, first)]
            statuses.append({refusal.status for refusal in refusals if refusal is not None})
        found = [status for (status,) in statuses]
        order = list(IkStatus)
        assert found == order[order.index(found[0]) : order.index(IkStatus.SOLVER_FAILED)]

    def test_every_check_runs_once_on_the_array_that_is_returned(
        self, bench: Bench, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        seen: list[tuple[str, int]] = []

        def watched(check):
            def run(candidate: Candidate, context: CommandContext):
                seen.append((check.__name__, id(candidate.joint_positions)))
                return check(candidate, context)

            return run

        monkeypatch.setattr(ik_solver, "COMMAND_CHECKS", tuple(map(watched, COMMAND_CHECKS)))
        # The kernel has checks of its own, which test_quick_ways.py compares with these.
        monkeypatch.setattr(ik_solver.IkSolver, "_solved_in_kernel", None)
        for _ in range(2):
            seen.clear()
            result = bench.server.solve(POSES[0])
            expected = [(check.__name__, id(result.joint_positions)) for check in COMMAND_CHECKS]
            assert result.accepted
            assert seen == expected

    def test_the_first_failure_ends_it(self, bench: Bench) -> None:
        """Of a target that fails several checks, the status is that of the first of them."""
        bench.server.safety = CommandSafety(
            max_target_age=1.0,
            workspace_box_upper=(1.0,) * 3,
            first_command=FirstCommandRule.NEAR,
        )
        pose = UNREACHABLE.copy()
        pose[3] = math.nan
        expected = [
            IkStatus.WRONG_FRAME,
            IkStatus.STALE_TARGET,
            IkStatus.OUTSIDE_WORKSPACE_BOX,
            IkStatus.NOT_FINITE,
            IkStatus.OUTSIDE_WORKSPACE,
            IkStatus.FIRST_COMMAND_TOO_FAR,
        ]
        found = [bench.server.solve(pose, "camera", 2.0).status]
        found.append(bench.server.solve(pose, "", 2.0).status)
        found.append(bench.server.solve(pose).status)
        bench.server.safety = replace(bench.server.safety, workspace_box_upper=(3.0,) * 3)
        found.append(bench.server.solve(pose).status)
        found.append(bench.server.solve(UNREACHABLE).status)
        found.append(bench.server.solve(POSES[0]).status)
        assert found == expected


@pytest.mark.parametrize(
    "changes",
    [
        {"max_target_age": math.nan},
        {"max_joint_velocity": -1.0},
        {"max_first_step": -0.1},
        {"workspace_box_lower": (0.0, 0.0, 1.0), "workspace_box_upper": (1.0, 1.0, 1.0)},
        {"workspace_box_lower": (math.nan, 0.0, 0.0)},
    ],
)
def test_limits_that_make_no_sense_are_refused(changes: dict[str, float]) -> None:
    """At once, and by name."""
    with pytest.raises(InvalidValue) as caught:
        replace(CommandSafety(), **changes)
    assert caught.value.name == next(iter(changes))


def test_by_default_a_command_near_the_measured_robot_is_a_first_one(bench: Bench) -> None:
    """And one that is far away is not, until the robot is near it."""
    bench.measured = bench.joint_positions(POSES[0])
    far = POSES[0].copy()
    far[0] += 0.19
    result = bench.server.solve(far)
    assert result.status is IkStatus.FIRST_COMMAND_TOO_FAR
    assert all(word in result.reason for word in ("x_drive_joint", "measured", "0.2"))
    assert bench.server.solve(POSES[0]).accepted
    # It is not the first any more.
    assert bench.server.solve(far).accepted
    bench.server.forget_last_command()
    assert bench.server.solve(far).status is IkStatus.FIRST_COMMAND_TOO_FAR


@pytest.mark.parametrize(
    ("rule", "accepted"),
    [
        (FirstCommandRule.FREE, True),
        (FirstCommandRule.NEAR_IF_MEASURED, True),
        (FirstCommandRule.NEAR, False),
    ],
)
def test_without_a_measurement_the_rule_decides(rule: FirstCommandRule, accepted: bool) -> None:
    """Only ``near`` insists on a measurement, and says what to do."""
    bench = Bench(CommandSafety(first_command=rule))
    result = bench.server.solve(POSES[0])
    assert result.accepted is accepted
    if not accepted:
        assert result.status is IkStatus.FIRST_COMMAND_TOO_FAR
        assert "joint_states" in result.reason
        bench.measured = bench.joint_positions(POSES[0])
        assert bench.server.solve(POSES[0]).accepted


def test_a_free_first_command_may_be_anywhere() -> None:
    """Even far from where the robot is measured."""
    bench = Bench(CommandSafety(first_command=FirstCommandRule.FREE))
    bench.measured = bench.joint_positions(POSES[0]) + 1.0
    assert bench.server.solve(POSES[0]).accepted


def test_every_command_is_near_the_measured_robot_if_wanted() -> None:
    """Not only the first: a robot that lags behind, or stands still, is not run away from."""
    bench = Bench(CommandSafety(max_measured_step=0.05))
    bench.measured = bench.joint_positions(POSES[0])
    assert bench.server.solve(POSES[0]).accepted
    refused = bench.server.solve(POSES[10])
    assert refused.status is IkStatus.TOO_FAR_FROM_MEASURED
    bench.measured = bench.joint_positions(POSES[10])
    assert bench.server.solve(POSES[10]).accepted


@pytest.mark.parametrize("rule", [FirstCommandRule.NEAR_IF_MEASURED, FirstCommandRule.NEAR])
def test_joint_states_that_can_not_be_used_refuse_the_first_command(
    rule: FirstCommandRule,
) -> None:
    """They are not taken for a robot that reports nothing."""
    bench = Bench(CommandSafety(first_command=rule))
    bench.fault = "the joint states lack wrist"
    result = bench.server.solve(POSES[0])
    assert result.status is IkStatus.FIRST_COMMAND_TOO_FAR
    assert bench.fault in result.reason
    bench.server.safety = CommandSafety(first_command=FirstCommandRule.FREE)
    assert bench.server.solve(POSES[0]).accepted


def test_joint_states_that_can_not_be_used_refuse_what_they_limit() -> None:
    """Without them the distance from the robot can't be checked."""
    bench = Bench(CommandSafety(max_measured_step=0.05))
    bench.measured = bench.joint_positions(POSES[0])
    assert bench.server.solve(POSES[0]).accepted
    bench.measured, bench.fault = None, "the joint states are too old"
    result = bench.server.solve(POSES[0])
    assert result.status is IkStatus.TOO_FAR_FROM_MEASURED
    assert bench.fault in result.reason
    bench.fault = None
    assert bench.server.solve(POSES[0]).accepted


def test_a_joint_may_not_go_faster_than_its_limit() -> None:
    """By the time since the last command, which a refusal does not change."""
    bench = Bench(CommandSafety(max_joint_velocity=0.5))
    assert bench.server.solve(POSES[0]).accepted
    step = np.abs(bench.joint_positions(POSES[1]) - bench.joint_positions(POSES[0])).max()
    bench.now += 1.9 * step
    refused = bench.server.solve(POSES[1])
    assert refused.status is IkStatus.JOINT_VELOCITY_TOO_LARGE
    assert "0.5" in refused.reason
    bench.now += 0.2 * step
    assert bench.server.solve(POSES[1]).accepted


def test_a_burst_counts_as_commands_at_the_expected_rate() -> None:
    """Two targets that arrive together were made one interval apart."""
    bench = Bench(CommandSafety(max_joint_velocity=0.1, expected_rate=1.0))
    assert bench.server.solve(POSES[0]).accepted
    assert bench.server.solve(POSES[1]).accepted
    assert bench.server.solve(POSES[10]).status is IkStatus.JOINT_VELOCITY_TOO_LARGE


@given(
    st.lists(st.floats(-3, 3), min_size=3, max_size=3),
    st.floats(0, 10),
    st.floats(0, 100, exclude_min=True),
)
def test_the_velocity_is_step_by_time(
    steps: list[float], interval: float, max_joint_velocity: float
) -> None:
    """For any numbers, also no time at all."""
    safety = CommandSafety(max_joint_velocity=max_joint_velocity)
    candidate = Candidate(load_robot("scara"), POSES[0], np.array([*steps, 0.0]))
    context = CommandContext(AcceptanceLimits(), np.zeros(4), Motion(safety, interval))
    refusal = check_joint_velocity(candidate, context)
    assert (refusal is None) == all(abs(s) <= max_joint_velocity * interval for s in steps)


@pytest.mark.parametrize(
    ("index", "value", "text"),
    [(0, 0.6, "0.6 m"), (1, -1.0, "-1 m"), (2, 0.9, "0.1 to 0.8 m")],
)
def test_a_target_outside_of_the_workspace_box_is_refused(
    index: int, value: float, text: str
) -> None:
    """Naming the axis, the value and the box."""
    bench = Bench(
        CommandSafety(workspace_box_lower=(0.1,) * 3, workspace_box_upper=(0.5, 0.5, 0.8))
    )
    pose = POSES[0].copy()
    pose[index] = value
    refused = bench.server.solve(pose)
    assert refused.status is IkStatus.OUTSIDE_WORKSPACE_BOX
    assert POSE_FIELDS[index] in refused.reason
    assert text in refused.reason
    assert bench.server.solve(POSES[0]).accepted
    pose[index] = math.nan
    assert bench.server.solve(pose).status is IkStatus.NOT_FINITE


@pytest.mark.parametrize(
    ("age", "text"),
    [(0.0, None), (0.09, None), (-0.09, None), (None, None), (0.11, "old"), (-0.2, "future")],
)
def test_a_target_is_stale_beyond_its_limit_in_either_direction(
    age: float | None, text: str | None
) -> None:
    """A stamp from the future is as wrong as an old one; no stamp is no age."""
    refusal = check_age(age, CommandSafety(max_target_age=0.1))
    assert (refusal is None) == (text is None)
    if text is not None:
        assert refusal is not None
        assert refusal.status is IkStatus.STALE_TARGET
        assert text in refusal.reason
    assert check_age(age, CommandSafety()) is None


def test_a_path_is_answered_as_a_whole(bench: Bench) -> None:
    """With the joint positions that its poses have one by one, and counted as one."""
    answer = bench.server.solve_path(POSES, 0.1, max_poses=100)
    assert answer.refusal is None
    assert answer.joint_positions is not None
    single = [bench.joint_positions(pose) for pose in POSES]
    np.testing.assert_array_equal(answer.joint_positions, single)
    outcomes = bench.server.end_period().outcomes
    assert (outcomes.received, outcomes.accepted) == (1, 1)


@pytest.mark.parametrize("bad", [0, 4, 10])
def test_a_path_with_one_bad_pose_is_refused_naming_it(bench: Bench, bad: int) -> None:
    """Nothing is commanded, and the last command is still that before the path."""
    poses = POSES.copy()
    poses[bad] = UNREACHABLE
    bench.server.safety = CommandSafety(max_joint_velocity=1.0)
    assert bench.server.solve(POSES[0]).accepted
    bench.now += 1.0
    answer = bench.server.solve_path(poses, 0.1, max_poses=100)
    assert answer.joint_positions is None
    assert answer.refusal is not None
    assert answer.refusal.status is IkStatus.OUTSIDE_WORKSPACE
    assert answer.refusal.reason.startswith(f"pose {bad} of 0 to 10: ")
    assert bench.server.solve(POSES[1]).accepted
    outcomes = bench.server.end_period().outcomes
    assert (outcomes.received, outcomes.accepted, outcomes.refused) == (3, 2, 1)


@pytest.mark.parametrize("count", [0, 11])
def test_a_path_has_a_length_that_can_be_answered_in_time(bench: Bench, count: int) -> None:
    """Neither none nor too many."""
    answer = bench.server.solve_path(POSES[:count], 0.1, max_poses=10)
    assert answer.refusal is not None
    assert answer.refusal.status is IkStatus.PATH_LENGTH
    assert f"{count} poses" in answer.refusal.reason


def test_a_path_in_another_frame_or_too_old_is_refused(bench: Bench) -> None:
    """As a single target is."""
    bench.server.safety = CommandSafety(max_target_age=1.0)
    for arguments, status in (
        (("camera", 0.0), IkStatus.WRONG_FRAME),
        (("", 2.0), IkStatus.STALE_TARGET),
    ):
        refusal = bench.server.solve_path(POSES, 0.1, 100, *arguments).refusal
        assert refusal is not None
        assert refusal.status is status


def test_the_speed_along_a_path_is_that_of_its_interval() -> None:
    """However fast it is computed; and only its beginning is compared with the measured robot."""
    bench = Bench(CommandSafety(max_joint_velocity=0.5, max_measured_step=0.05))
    bench.measured = bench.joint_positions(POSES[0])
    step = np.abs(np.diff([bench.joint_positions(pose) for pose in POSES], axis=0)).max()
    refused = bench.server.solve_path(POSES, 1.9 * step, max_poses=100).refusal
    assert refused is not None
    assert refused.status is IkStatus.JOINT_VELOCITY_TOO_LARGE
    assert bench.server.solve_path(POSES, 2.1 * step, max_poses=100).refusal is None
    # From its end the next one starts.
    bench.now += 1.0
    bench.measured = bench.joint_positions(POSES[10])
    assert bench.server.solve(POSES[10]).accepted


def test_the_velocity_after_a_path_counts_from_its_command() -> None:
    """Not from the command before it, which would allow any step."""
    bench = Bench(CommandSafety(max_joint_velocity=0.5))
    assert bench.server.solve(POSES[0]).accepted
    bench.now += 100.0
    assert bench.server.solve_path(POSES[:2], 1.0, max_poses=100).refusal is None
    bench.now += 0.01
    refused = bench.server.solve(POSES[10])
    assert refused.status is IkStatus.JOINT_VELOCITY_TOO_LARGE
    assert "0.01 s" in refused.reason
    step = np.abs(bench.joint_positions(POSES[10]) - bench.joint_positions(POSES[1])).max()
    bench.now += 2.0 * step
    assert bench.server.solve(POSES[10]).accepted


@pytest.mark.parametrize("rule", list(FirstCommandRule))
@pytest.mark.parametrize(("roll", "yaw"), [(0.2, 1.2), (1.3, 0.4), (0.1, 0.1)])
def test_the_first_command_stays_with_the_robot_where_the_pose_leaves_a_choice(
    rule: FirstCommandRule, roll: float, yaw: float
) -> None:
    """At a pitch of 90 degrees, where only the difference of yaw and roll is determined."""
    bench = Bench(CommandSafety(first_command=rule, max_first_step=1e-3))
    kinematics = bench.server.solver.robot.forward_kinematics
    assert isinstance(kinematics, GantryKinematics)
    task = np.array([[0.3, 0.3, 0.6, roll, math.pi / 2, yaw]])
    bench.measured = kinematics.joint_positions(task)[0]
    result = bench.server.solve(kinematics.poses(bench.measured[np.newaxis])[0])
    np.testing.assert_allclose(result.joint_positions, bench.measured, atol=1e-5)


def test_the_first_step_is_limited_from_the_measured_robot_by_every_rule() -> None:
    """max_joint_step limits it too, however free the first command is."""
    bench = Bench(CommandSafety(first_command=FirstCommandRule.FREE))
    bench.server.solver = replace(
        bench.server.solver, limits=AcceptanceLimits(max_joint_step=0.05)
    )
    bench.measured = bench.joint_positions(POSES[0])
    assert bench.server.solve(POSES[10]).status is IkStatus.JOINT_STEP_TOO_LARGE
    assert bench.server.solve(POSES[0]).accepted
