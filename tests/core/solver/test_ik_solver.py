"""The solver's checks, each refusing in its turn, and what an accepted result promises. ROS-free.

The network is a stand-in whose solutions are given, so that every check can be reached.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_core.errors import InvalidValue, WrongShape
from annik_core.installation import default_model_path
from annik_core.pose import FloatArray, pose_distance, pose_from_roll_pitch_yaw
from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.safety import AcceptanceLimits, IkStatus
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import IkResult, RefinementOptions

IN_WORKSPACE = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], [0.2, 0.3, 0.4])


@dataclass
class StandInNetwork:
    """Solves poses by a given function."""

    robot: Robot
    answer: Callable[[FloatArray], FloatArray]

    def after_encoding(self, name: str) -> None:
        """None: its answers are not the kernel's."""

    def joint_positions(self, poses: FloatArray) -> FloatArray:
        """As the artifact's."""
        return self.answer(poses)

    def joint_positions_at(self, pose: FloatArray) -> FloatArray:
        """As the artifact's."""
        return self.answer(pose[np.newaxis])[0]

    start_at = joint_positions_at


@pytest.fixture(scope="module")
def packaged() -> IkSolver:
    """The solver on the packaged model."""
    return IkSolver.from_file(default_model_path())


def solver(robot: Robot, answer: Callable[[FloatArray], FloatArray], **limits: float) -> IkSolver:
    """A solver on a stand-in network."""
    return IkSolver(StandInNetwork(robot, answer), AcceptanceLimits(**limits))  # type: ignore[arg-type]


def exact(robot: Robot) -> Callable[[FloatArray], FloatArray]:
    """The exact inverse, away from the gimbal edge."""
    kinematics = robot.forward_kinematics
    assert isinstance(kinematics, GantryKinematics)
    task = np.concatenate([[0.3, 0.3, 0.6], [0.2, 0.3, 0.4]])
    joints = kinematics.joint_positions(task[np.newaxis])
    return lambda poses: joints.copy()


def no_answer(poses: FloatArray) -> FloatArray:
    """For targets that must not reach the network."""
    raise AssertionError("the network was asked")


@pytest.mark.parametrize(
    ("pose", "status"),
    [
        ([np.nan, 0.3, 0.6, 0, 0, 0, 1], IkStatus.NOT_FINITE),
        ([0.3, 0.3, 0.6, 0, 0, np.inf, 1], IkStatus.NOT_FINITE),
        ([0.3, 0.3, 0.6, 0, 0, 0, 0], IkStatus.NOT_UNIT_QUATERNION),
        ([0.3, 0.3, 0.6, 0, 0, 0, 1.1], IkStatus.NOT_UNIT_QUATERNION),
        ([0.3, 0.3, 1.6, 0, 0, 0, 1], IkStatus.OUTSIDE_WORKSPACE),
        ([1e300, 0.3, 0.6, 0, 0, 0, 1], IkStatus.OUTSIDE_WORKSPACE),
    ],
)
def test_a_bad_target_never_reaches_the_network(
    gantry: Robot, pose: list[float], status: IkStatus
) -> None:
    """It is refused with a reason and carries no joint positions."""
    result = solver(gantry, no_answer).solve(pose)
    assert result.status is status
    assert result.joint_positions is None
    assert not result.accepted
    assert result.reason


def test_an_answer_beyond_the_joint_limits_is_refused(gantry: Robot) -> None:
    """Never clamped: the refusal names the joint, its value and its limits."""
    result = solver(gantry, lambda poses: np.full((1, 6), 1.6)).solve(IN_WORKSPACE)
    assert result.status is IkStatus.JOINT_LIMIT
    assert all(word in result.reason for word in ("x_drive_joint", "1.6", "[0, 1.5708]"))
    assert result.joint_positions is None


def test_an_answer_of_nan_is_refused(gantry: Robot) -> None:
    """NaN compares as neither inside nor outside; it must not pass."""
    result = solver(gantry, lambda poses: np.full((1, 6), np.nan)).solve(IN_WORKSPACE)
    assert result.status is IkStatus.JOINT_LIMIT
    assert result.joint_positions is None


@pytest.mark.parametrize(
    ("joint", "off_by", "expected"),
    [(0, 0.001, ["position", "0.573 mm"]), (5, 0.001, ["orientation", "0.1719 degrees"])],
)
def test_an_answer_that_misses_the_target_is_refused(
    gantry: Robot, joint: int, off_by: float, expected: list[str]
) -> None:
    """The residual is that of the forward kinematics, on both sides of the limit."""
    answer = exact(gantry)(IN_WORKSPACE)
    answer[0, joint] += off_by
    strict = {"max_position_residual": 0.00057, "max_orientation_residual": 0.0029}
    lax = {"max_position_residual": 0.00058, "max_orientation_residual": 0.0031}
    refused = solver(gantry, lambda poses: answer.copy(), **strict).solve(IN_WORKSPACE)
    assert refused.status is IkStatus.RESIDUAL_TOO_LARGE
    assert all(word in refused.reason for word in expected)
    assert refused.joint_positions is None
    accepted = solver(gantry, lambda poses: answer.copy(), **lax).solve(IN_WORKSPACE)
    assert accepted.accepted


def test_a_joint_step_beyond_the_limit_is_refused(gantry: Robot) -> None:
    """Measured from the previous command; without one there is no step."""
    answer = exact(gantry)
    previous = answer(IN_WORKSPACE)[0]
    previous[3] -= 0.11
    bounded = solver(gantry, answer, max_joint_step=0.1)
    refused = bounded.solve(IN_WORKSPACE, previous)
    assert refused.status is IkStatus.JOINT_STEP_TOO_LARGE
    assert all(word in refused.reason for word in ("roll_drive_joint", "0.11"))
    assert bounded.solve(IN_WORKSPACE).accepted


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_a_limit_that_is_not_positive_is_refused(value: float) -> None:
    """Zero, negative, NaN: nothing or everything would pass."""
    with pytest.raises(InvalidValue) as caught:
        AcceptanceLimits(max_joint_step=value)
    assert caught.value.name == "max_joint_step"


def test_wrong_shape_is_a_fault_of_the_caller(packaged: IkSolver) -> None:
    """Not a refusal: a program that passes six numbers is wrong."""
    with pytest.raises(WrongShape):
        packaged.solve([0.3, 0.3, 0.6, 0, 0, 0])


def test_names_and_lists_will_do(packaged: IkSolver) -> None:
    """A packaged model by its name, a path as text, a pose and previous positions as lists."""
    expected = packaged.solve(IN_WORKSPACE).joint_positions
    assert expected is not None
    for source in ("gantry", str(default_model_path())):
        solver = IkSolver.from_file(source)
        for previous in (None, expected.tolist()):
            found = solver.solve(IN_WORKSPACE.tolist(), previous=previous).joint_positions
            assert np.array_equal(found, expected)


@pytest.mark.parametrize("previous", [[0.0] * 5, [[0.0] * 6], 0.0])
def test_previous_joint_positions_are_one_per_joint(packaged: IkSolver, previous: object) -> None:
    with pytest.raises(WrongShape):
        packaged.solve(IN_WORKSPACE, previous)  # type: ignore[arg-type]


any_number = st.one_of(st.floats(), st.floats(-1, 1))


@given(st.lists(any_number, min_size=7, max_size=7))
def test_whatever_is_accepted_is_finite_in_limits_and_near(
    packaged: IkSolver, pose: list[float]
) -> None:
    """For any seven numbers at all."""
    result = packaged.solve(pose)
    if result.joint_positions is None:
        assert result.reason
        return
    assert packaged.robot.joint_limits.contains(result.joint_positions)
    assert result.position_residual <= packaged.limits.max_position_residual
    assert result.orientation_residual <= packaged.limits.max_orientation_residual


@given(st.lists(st.floats(20, 50), min_size=6, max_size=6))
def test_every_pose_of_the_workspace_is_answered(packaged: IkSolver, q_deg: list[float]) -> None:
    """Faces, edges and corners included, the gimbal edge too."""
    pose = packaged.robot.forward_kinematics.poses(np.radians([q_deg]))[0]
    result = packaged.solve(pose)
    assert result.accepted, result.reason


@given(st.lists(st.floats(20, 50), min_size=6, max_size=6))
def test_a_quaternion_and_its_negative_are_the_same_target(
    packaged: IkSolver, q_deg: list[float]
) -> None:
    """Same joint positions for both."""
    pose = packaged.robot.forward_kinematics.poses(np.radians([q_deg]))[0]
    negated = np.concatenate([pose[:3], -pose[3:]])
    one, other = packaged.solve(pose), packaged.solve(negated)
    assert one.joint_positions is not None
    assert other.joint_positions == pytest.approx(one.joint_positions, abs=1e-8)


def test_the_same_pose_gives_the_same_answer(packaged: IkSolver) -> None:
    """Bit for bit."""
    first = packaged.solve(IN_WORKSPACE).joint_positions
    assert np.array_equal(first, packaged.solve(IN_WORKSPACE).joint_positions)


def test_a_batch_is_its_rows(packaged: IkSolver) -> None:
    """Good and bad targets in one batch, each answered for itself."""
    bad = np.full(7, np.nan)
    results = packaged.solve_batch([IN_WORKSPACE, bad, IN_WORKSPACE])
    assert [result.status for result in results] == [
        IkStatus.SUCCESS,
        IkStatus.NOT_FINITE,
        IkStatus.SUCCESS,
    ]


def test_an_answer_can_not_be_altered(packaged: IkSolver) -> None:
    """What was checked is what is published."""
    joint_positions = packaged.solve(IN_WORKSPACE).joint_positions
    assert joint_positions is not None
    with pytest.raises(ValueError, match="read-only"):
        joint_positions[0] = 0.0


class TestContinuityAtTheGimbalEdge:
    """A path of small steps gives joint positions of small steps, on to and along the edge."""

    @staticmethod
    def follow(packaged: IkSolver, roll_pitch_yaw_deg: FloatArray) -> FloatArray:
        """Joint positions [degrees] along a path of orientations, each from the one before."""
        previous: IkResult | None = None
        rows = []
        for angles in np.radians(roll_pitch_yaw_deg):
            pose = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], angles)
            result = packaged.solve(pose, previous)
            assert result.joint_positions is not None, result.reason
            assert result.orientation_residual < 1e-3
            previous = result
            rows.append(result.joint_positions)
        return np.degrees(rows)

    @pytest.mark.parametrize(("roll", "yaw"), [(10.0, 80.0), (80.0, 10.0), (30.0, 30.0), (0, 0)])
    def test_on_to_the_edge_and_back(self, packaged: IkSolver, roll: float, yaw: float) -> None:
        """Roll and yaw stay what they were, though at the edge the pose does not tell them."""
        pitch = np.concatenate(
            [np.linspace(80, 90, 51), [90 - 1e-7, 90, 90], np.linspace(90, 80, 51)]
        )
        path = np.column_stack([np.full(len(pitch), roll), pitch, np.full(len(pitch), yaw)])
        joints = self.follow(packaged, path)
        assert np.abs(np.diff(joints, axis=0)).max() < 0.08
        assert joints[:, 3] == pytest.approx((roll + 60) / 3, abs=0.02)
        assert joints[:, 5] == pytest.approx((yaw + 60) / 3, abs=0.02)

    def test_holding_a_pose_on_the_edge(self, packaged: IkSolver) -> None:
        """The same target again and again gives the same joint positions."""
        path = np.tile([5.0, 90.0, 85.0], (1000, 1))
        joints = self.follow(packaged, np.vstack([[5.0, 89.9, 85.0], path]))
        assert np.ptp(joints[1:], axis=0).max() < 1e-9

    def test_the_residual_is_measured_against_the_target_itself(self, gantry: Robot) -> None:
        """Not against the pose that stands in for it on the edge."""
        kinematics = gantry.forward_kinematics
        assert isinstance(kinematics, GantryKinematics)
        tilted = np.array([[0.3, 0.3, 0.6, 0.7, np.pi / 2 - 1e-7, 0.7]])
        answer = kinematics.joint_positions(tilted)
        target = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], [0.7, np.pi / 2, 0.7])
        result = solver(gantry, lambda poses: answer.copy()).solve(target)
        assert result.orientation_residual == pytest.approx(1e-7, rel=0.2)

    def test_along_the_edge(self, packaged: IkSolver) -> None:
        """Turning at a pitch of 90 degrees moves roll and yaw evenly."""
        roll = np.linspace(0, 90, 91)
        path = np.column_stack([roll, np.full(91, 90.0), 90 - roll])
        joints = self.follow(packaged, path)
        assert np.abs(np.diff(joints, axis=0)).max() < 0.4


class TestRefined:
    """The network's solution, refined: what is accepted is the solution, not near it."""

    @pytest.fixture(scope="class")
    def ur5e(self) -> Robot:
        return load_robot("ur5e")

    @staticmethod
    def goals(robot: Robot, count: int) -> FloatArray:
        """Joint positions in the middle half of the box, so that 0.1 rad off is inside too."""
        box = robot.joint_box
        quarter = 0.25 * (box.upper - box.lower)
        rng = np.random.default_rng(6)
        return rng.uniform(box.lower + quarter, box.upper - quarter, (count, robot.dof))

    @staticmethod
    def refining(robot: Robot, answer: FloatArray, **options: object) -> IkSolver:
        """A solver whose network answers every pose with the same joint positions."""
        network = StandInNetwork(robot, lambda poses: np.tile(answer, (len(poses), 1)))
        return IkSolver(network, **options)  # type: ignore[arg-type]

    @pytest.mark.parametrize(
        ("mode", "arm", "gantry"),
        [
            (SolverMode.AUTO, True, False),
            (SolverMode.NETWORK, False, False),
            (SolverMode.REFINED, True, True),
        ],
    )
    def test_the_mode_says_what_is_refined(
        self, ur5e: Robot, packaged: IkSolver, mode: SolverMode, arm: bool, gantry: bool
    ) -> None:
        """Left to itself, an arm, and not the gantry."""
        goal = self.goals(ur5e, 1)
        pose = ur5e.forward_kinematics.poses(goal)[0]
        for_arm = self.refining(ur5e, goal[0] + 1e-4, mode=mode)
        for_gantry = IkSolver(packaged.artifact, mode=mode)
        assert (for_arm.refines, for_gantry.refines) == (arm, gantry)
        result = for_arm.solve(pose)
        assert result.accepted
        assert (result.newton_steps > 0) == (result.position_residual < 5e-7) == arm
        assert (for_gantry.solve(IN_WORKSPACE).newton_steps > 0) == gantry
        assert packaged.mode is SolverMode.AUTO

    def test_what_is_accepted_is_the_solution(self, ur5e: Robot) -> None:
        """Its residuals are those of the forward kinematics at exactly these joint positions."""
        goals = self.goals(ur5e, 100)
        for goal, pose in zip(goals, ur5e.forward_kinematics.poses(goals), strict=True):
            result = self.refining(ur5e, goal + 0.05).solve(pose)
            assert result.joint_positions is not None, result.reason
            assert ur5e.joint_box.contains(result.joint_positions)
            achieved = ur5e.forward_kinematics.poses(result.joint_positions[None])[0]
            distances = result.position_residual, result.orientation_residual
            assert distances == pytest.approx(pose_distance(pose, achieved), abs=1e-10)
            assert max(distances) <= 5e-7
            assert 0 < result.newton_steps <= 10
            with pytest.raises(ValueError, match="read-only"):
                result.joint_positions[0] = 0.0

    def test_the_gantry_can_be_refined_too(self, gantry: Robot) -> None:
        """From an answer that is off by more than the network mode would accept."""
        answer = exact(gantry)(IN_WORKSPACE)[0]
        bad = self.refining(gantry, answer + 0.02)
        assert bad.solve(IN_WORKSPACE).status is IkStatus.RESIDUAL_TOO_LARGE
        result = self.refining(gantry, answer + 0.02, mode=SolverMode.REFINED).solve(IN_WORKSPACE)
        assert result.joint_positions == pytest.approx(answer, abs=1e-6)

    def test_what_does_not_converge_is_refused(self, ur5e: Robot) -> None:
        """With what is left and the steps, and without joint positions."""
        pose = np.array([0.0, 0.0, 0.1625 + 1.0, 0.0, 0.0, 0.0, 1.0])
        result = self.refining(ur5e, ur5e.joint_box.centre).solve(pose)
        assert result.status is IkStatus.NOT_CONVERGED
        assert result.joint_positions is None
        assert result.reference is None
        assert 0 < result.newton_steps <= 10
        assert 0.05 < result.position_residual < 2.0
        assert 0.0 <= result.orientation_residual <= np.pi
        assert f"{1e3 * result.position_residual:.4g} mm" in result.reason
        assert f"{result.newton_steps} steps" in result.reason

    def test_a_solution_outside_the_joint_box_is_none(self, ur5e: Robot) -> None:
        """Though the joint limits would allow it, and the network answers it."""
        beyond = ur5e.joint_box.upper + 0.3
        assert ur5e.joint_limits.contains(beyond)
        pose = ur5e.forward_kinematics.poses(beyond[None])[0]
        assert self.refining(ur5e, beyond).solve(pose).status is IkStatus.NOT_CONVERGED
        network = self.refining(ur5e, beyond, mode=SolverMode.NETWORK)
        assert network.solve(pose).accepted

    def test_no_steps_accept_only_an_exact_network(self, ur5e: Robot) -> None:
        goal = self.goals(ur5e, 1)
        pose = ur5e.forward_kinematics.poses(goal)[0]
        none = RefinementOptions(max_newton_steps=0)
        assert self.refining(ur5e, goal[0], refinement_options=none).solve(pose).accepted
        refused = self.refining(ur5e, goal[0] + 1e-5, refinement_options=none).solve(pose)
        assert (refused.status, refused.newton_steps) == (IkStatus.NOT_CONVERGED, 0)

    def test_acceptance_limits_hold_of_refined_answers_too(self, ur5e: Robot) -> None:
        """A tolerance wider than they are lets nothing more pass; a joint step is measured."""
        goal = self.goals(ur5e, 1)
        pose = ur5e.forward_kinematics.poses(goal)[0]
        wide = RefinementOptions(max_newton_steps=0, tolerance=0.1)
        result = self.refining(ur5e, goal[0] + 0.01, refinement_options=wide).solve(pose)
        assert result.status is IkStatus.RESIDUAL_TOO_LARGE
        assert result.position_residual > 1e-3
        limits = AcceptanceLimits(max_joint_step=0.1)
        stepping = self.refining(ur5e, goal[0], limits=limits).solve(pose, goal[0] - 0.2)
        assert stepping.status is IkStatus.JOINT_STEP_TOO_LARGE
        assert " 0.2," in stepping.reason

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    # Of a whole robot the network is one of many starts.
    @pytest.mark.parametrize("mode", sorted({*SolverMode} - {SolverMode.WHOLE_ROBOT}, key=str))
    @pytest.mark.parametrize("seeded", [False, True])
    def test_a_network_without_finite_numbers_is_refused(
        self, ur5e: Robot, value: float, mode: SolverMode, seeded: bool
    ) -> None:
        """It is not mended: such a network is broken."""
        goal = self.goals(ur5e, 1)
        answer = goal[0].copy()
        answer[2] = value
        broken = self.refining(ur5e, answer, mode=mode, seed_from_previous=seeded)
        result = broken.solve(ur5e.forward_kinematics.poses(goal)[0], goal[0])
        assert result.status is IkStatus.JOINT_LIMIT
        assert all(word in result.reason for word in ("elbow_joint", f"{value:.6g}"))
        assert result.joint_positions is None

    def test_absurd_targets_are_refused_without_a_warning(self, ur5e: Robot) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for x in (10.0, 1e200, -1.7e308):
                result = solver(ur5e, no_answer).solve([x, 0, 0, 0, 0, 0, 1])
                assert result.status is IkStatus.OUTSIDE_WORKSPACE

    def test_a_batch_is_its_rows(self, ur5e: Robot) -> None:
        """Refusals among them, and with a network that rounds in another way for many poses."""
        goals = self.goals(ur5e, 40)
        poses = ur5e.forward_kinematics.poses(goals)
        poses[5, 0] = np.nan
        poses[7, 3:] = 0.0
        poses[11, 2] = 9.0
        poses[13, :3] = [0.0, 0.0, 1.1]

        def rough(batch: FloatArray) -> FloatArray:
            rows = [int(np.argmin(np.linalg.norm(poses - pose, axis=1))) for pose in batch]
            return goals[rows] + 0.05 + 1e-15 * len(batch)

        poses = np.nan_to_num(poses, nan=1e9)
        asked = poses.copy()
        asked[5, 0] = np.nan
        for mode in SolverMode:
            one = IkSolver(StandInNetwork(ur5e, rough), mode=mode)  # type: ignore[arg-type]
            batch = one.solve_batch(asked)
            alone = [one.solve(pose) for pose in asked]
            assert [result.status for result in batch] == [result.status for result in alone]
            refined = mode is not SolverMode.NETWORK
            assert sum(result.accepted for result in batch) == (36 if refined else 0)
            for together, single in zip(batch, alone, strict=True):
                assert together.newton_steps == single.newton_steps
                if single.joint_positions is not None:
                    assert together.joint_positions == pytest.approx(
                        single.joint_positions, abs=1e-9
                    )
        assert one.solve_batch([]) == []

    def test_the_history_has_no_effect(self, ur5e: Robot) -> None:
        """Unless it is asked for: the same pose, the same bits."""
        goals = self.goals(ur5e, 20)
        poses = ur5e.forward_kinematics.poses(goals)
        one = self.refining(ur5e, ur5e.joint_box.centre)
        assert not one.seed_from_previous
        fresh = [one.solve(pose) for pose in poses]
        for previous in (None, goals[0], ur5e.joint_box.lower, fresh[3], fresh[-1]):
            for pose, first in zip(poses, fresh, strict=True):
                again = one.solve(pose, previous)
                assert again.status is first.status
                assert again.newton_steps == first.newton_steps
                if first.joint_positions is not None and again.joint_positions is not None:
                    assert again.joint_positions.tobytes() == first.joint_positions.tobytes()

    def test_a_near_previous_answer_saves_steps(self, ur5e: Robot) -> None:
        """Where the network answers badly, and the robot is nearly there."""
        goal = self.goals(ur5e, 1)[0]
        path = goal + np.linspace(0, 0.01, 5)[:, None]
        bad = goal + 0.3
        plain = self.refining(ur5e, bad)
        seeded = self.refining(ur5e, bad, seed_from_previous=True)
        previous: IkResult | FloatArray = goal - 0.002
        for pose in ur5e.forward_kinematics.poses(path):
            without, result = plain.solve(pose, previous), seeded.solve(pose, previous)
            assert result.accepted, result.reason
            assert result.newton_steps < without.newton_steps
            previous = result

    def test_a_far_previous_answer_is_not_begun_at(self, ur5e: Robot) -> None:
        """Then the network's is, bit for bit; likewise without any, or after a refusal."""
        goal = self.goals(ur5e, 1)
        pose = ur5e.forward_kinematics.poses(goal)[0]
        plain = self.refining(ur5e, goal[0] + 0.01).solve(pose)
        seeded = self.refining(ur5e, goal[0] + 0.01, seed_from_previous=True)
        refusal = seeded.solve([9.0, 0, 0, 0, 0, 0, 1])
        for previous in (ur5e.joint_box.lower, None, refusal):
            result = seeded.solve(pose, previous)
            assert result.joint_positions is not None
            assert plain.joint_positions is not None
            assert result.joint_positions.tobytes() == plain.joint_positions.tobytes()

    def test_the_previous_answer_is_left_as_it_was(self, ur5e: Robot) -> None:
        goal = self.goals(ur5e, 1)
        pose = ur5e.forward_kinematics.poses(goal)[0]
        previous = goal[0].copy()
        result = self.refining(ur5e, goal[0] + 0.2, seed_from_previous=True).solve(pose, previous)
        assert result.newton_steps == 0
        assert previous.flags.writeable
        assert not np.shares_memory(previous, result.joint_positions)

    def test_the_gimbal_edge_of_the_gantry_when_refined(self, packaged: IkSolver) -> None:
        """Every pose of the workspace has an answer in refined mode too."""
        refined = IkSolver(packaged.artifact, mode=SolverMode.REFINED)
        rng = np.random.default_rng(7)
        for q_deg in rng.choice([20.0, 27.0, 35.0, 50.0], (200, 6)):
            pose = packaged.robot.forward_kinematics.poses(np.radians([q_deg]))[0]
            result = refined.solve(pose)
            assert result.accepted, (q_deg, result.reason)
            assert max(result.position_residual, result.orientation_residual) <= 5e-7
