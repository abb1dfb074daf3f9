"""``IkSolver`` on the whole robot: preferred, continued and all solutions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support.urdf_texts import joint, urdf

from annik_core.errors import InvalidValue, NonFiniteValue
from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import FULL_TURN
from annik_core.safety import AcceptanceLimits, IkStatus
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_core.solver.search import SearchOptions

HOME = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])


def whole(name: str, **options: object) -> IkSolver:
    return IkSolver(
        load_model(name),
        AcceptanceLimits(),
        SolverMode.WHOLE_ROBOT,
        search_options=SearchOptions(**options),
    )


@pytest.fixture(scope="module")
def ur5e() -> IkSolver:
    return whole("ur5e")


def pose_at(solver: IkSolver, joint_positions: FloatArray) -> FloatArray:
    return solver.robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]


def straight(start: FloatArray, end: FloatArray, points: int) -> FloatArray:
    parts = np.linspace(0.0, 1.0, points)
    turns = Slerp([0.0, 1.0], Rotation.from_quat([start[3:], end[3:]]))(parts).as_quat()
    return np.column_stack([start[:3] + parts[:, np.newaxis] * (end - start)[:3], turns])


class TestSolutions:
    def test_a_ur_has_eight_nearest_first(self, ur5e: IkSolver) -> None:
        found = ur5e.solutions(pose_at(ur5e, HOME), HOME)
        assert len(found) == 8
        assert found[0].joint_positions == pytest.approx(HOME, abs=1e-6)
        assert all(result.accepted and result.position_residual < 1e-6 for result in found)
        steps = [np.abs(result.joint_positions - HOME).max() for result in found]
        assert steps == sorted(steps)

    def test_turns_are_nearest_or_all_of_them(self, ur5e: IkSolver) -> None:
        near = HOME + np.array([6.0, 0.0, 0.0, 0.0, 0.0, -6.0])
        pose = pose_at(ur5e, HOME)
        limits = ur5e.robot.joint_limits
        turned = HOME + np.array([FULL_TURN, 0.0, 0.0, 0.0, 0.0, -FULL_TURN])
        assert limits.contains(0.999 * turned)
        found = [result.joint_positions for result in ur5e.solutions(pose, near)]
        assert len(found) == 8
        assert min(np.abs(one[5] - turned[5]) for one in found) < 1e-5
        assert np.abs(found[0] - near).max() <= np.pi + 0.3
        every = ur5e.solutions(pose, near, turns=True)
        assert len(every) > 8 * 2**4
        different = np.unique(np.round([result.joint_positions for result in every], 6), axis=0)
        assert len(different) == len(every)
        assert all(limits.contains(result.joint_positions) for result in every)

    def test_of_a_box_there_is_one(self) -> None:
        solver = IkSolver(load_model("ur5e"))
        pose = pose_at(solver, solver.robot.joint_box.centre)
        assert len(solver.solutions(pose)) == 1

    def test_none_out_of_reach_and_none_of_a_bad_pose(self, ur5e: IkSolver) -> None:
        assert ur5e.solutions([9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]) == []
        assert ur5e.solutions([np.nan] * 7) == []

    @pytest.mark.parametrize("value", [np.nan, np.inf])
    def test_joint_positions_that_are_not_finite_are_named(
        self, ur5e: IkSolver, value: float
    ) -> None:
        positions = ur5e.robot.joint_box.centre.copy()
        pose = pose_at(ur5e, positions)
        positions[2] = value
        for solve in (ur5e.solve, ur5e.solutions):
            with pytest.raises(NonFiniteValue) as caught:
                solve(pose, positions)
            assert caught.value.field == "position of elbow_joint"

    def test_the_spacing_of_a_redundant_arm(self) -> None:
        coarse, fine = whole("panda", spacing=1.0), whole("panda", spacing=0.3)
        pose = pose_at(coarse, coarse.robot.joint_limits.centre)
        assert 1 < len(coarse.solutions(pose)) < len(fine.solutions(pose))

    def test_only_an_arm_is_searched_whole(self) -> None:
        with pytest.raises(InvalidValue):
            whole("gantry")


class TestPreferred:
    def test_it_is_a_function_of_the_pose(self, ur5e: IkSolver) -> None:
        pose = pose_at(ur5e, HOME)
        first = ur5e.solve(pose)
        ur5e.solve(pose_at(ur5e, HOME + 0.5))
        assert np.array_equal(ur5e.solve(pose).joint_positions, first.joint_positions)

    def test_it_is_the_solution_in_the_box_where_the_network_knows_one(
        self, ur5e: IkSolver
    ) -> None:
        box = ur5e.robot.joint_box
        inside = box.sample(50, np.random.default_rng(3))
        results = [ur5e.solve(pose_at(ur5e, positions)) for positions in inside]
        assert all(result.accepted for result in results)
        assert sum(box.contains(result.joint_positions) for result in results) >= 49

    def test_of_a_model_in_a_box_it_is_the_solution_of_that_model(self, ur5e: IkSolver) -> None:
        robot = ur5e.robot
        assert not robot.has_whole_box
        boxed = IkSolver(ur5e.artifact, mode=SolverMode.REFINED)
        for pose in robot.forward_kinematics.poses(
            robot.joint_box.sample(40, np.random.default_rng(8))
        ):
            wanted = boxed.solve(pose)
            if wanted.accepted:
                found = ur5e.solve(pose).joint_positions
                assert found == pytest.approx(wanted.joint_positions, abs=1e-5)

    def test_a_batch_is_the_same(self, ur5e: IkSolver) -> None:
        poses = np.array([pose_at(ur5e, HOME + shift) for shift in (0.0, 0.3, -0.4)])
        for one, pose in zip(ur5e.solve_batch(poses), poses, strict=True):
            assert np.array_equal(one.joint_positions, ur5e.solve(pose).joint_positions)

    def test_out_of_reach(self, ur5e: IkSolver) -> None:
        # Within the ball that the links could span, but not where this arm comes.
        pose = np.array([0.0, 0.0, 0.1625, 1.0, 0.0, 0.0, 0.0])
        assert ur5e.solve(pose).status is IkStatus.NOT_CONVERGED


class TestContinued:
    def test_a_path_stays_on_its_branch(self, ur5e: IkSolver) -> None:
        """Whichever of the eight it begins on; steps are about as long as those before."""
        start, end = pose_at(ur5e, HOME), pose_at(ur5e, HOME + 0.15)
        for first in ur5e.solutions(start, HOME):
            previous = first.joint_positions
            last = None
            for pose in straight(start, end, 60)[1:]:
                result = ur5e.solve(pose, previous)
                if result.status is IkStatus.BRANCH_ENDS:
                    break
                assert result.accepted
                step = np.abs(result.joint_positions - previous).max()
                assert last is None or step < 1.5 * last + 1e-3
                previous, last = result.joint_positions, step

    def test_where_the_branch_ends_the_target_is_refused(self) -> None:
        limited, free = whole("xarm6"), whole("xarm6", allow_branch_change=True)
        limits = limited.robot.joint_limits
        start = limited.robot.joint_box.centre.copy()
        start[5] = limits.upper[5] - 0.02
        end = start.copy()
        end[5] += 0.06
        pose = pose_at(limited, end)
        refused = limited.solve(pose, start)
        assert refused.status is IkStatus.BRANCH_ENDS
        assert refused.joint_positions is None
        changed = free.solve(pose, start)
        assert changed.accepted
        assert limits.contains(changed.joint_positions)
        assert np.abs(changed.joint_positions - start).max() > 1.0

    @pytest.mark.parametrize("home", [[0.0] * 6, [0.0, -1.5708, 0.0, -1.5708, 0.0, 0.0]])
    def test_from_a_singularity_where_arms_are_parked_near_targets_are_reached(
        self, ur5e: IkSolver, home: list[float]
    ) -> None:
        rng = np.random.default_rng(0)
        for size in (1e-4, 1e-3, 0.01, 0.03):
            for _ in range(20):
                pose = pose_at(ur5e, np.array(home) + rng.uniform(-size, size, 6))
                result = ur5e.solve(pose, home)
                assert result.status is IkStatus.SUCCESS
                assert np.abs(result.joint_positions - home).max() < 0.2

    def test_limits_on_steps_hold_for_a_change_of_the_branch(self) -> None:
        solver = IkSolver(
            load_model("xarm6"),
            AcceptanceLimits(max_joint_step=0.5),
            SolverMode.WHOLE_ROBOT,
            search_options=SearchOptions(allow_branch_change=True),
        )
        start = solver.robot.joint_box.centre.copy()
        start[5] = solver.robot.joint_limits.upper[5] - 0.02
        end = start.copy()
        end[5] += 0.06
        result = solver.solve(pose_at(solver, end), start)
        assert result.status is IkStatus.JOINT_STEP_TOO_LARGE

    def test_a_far_target_is_reached(self, ur5e: IkSolver) -> None:
        """With a motion of the joints that passes no singularity."""
        rng = np.random.default_rng(4)
        ends = HOME + rng.uniform(-0.7, 0.7, (50, 6))
        results = [ur5e.solve(pose_at(ur5e, end), HOME) for end in ends]
        assert sum(result.accepted for result in results) >= 48

    def test_turns_are_kept(self, ur5e: IkSolver) -> None:
        turned = HOME + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 5.5])
        result = ur5e.solve(pose_at(ur5e, turned + 0.01), turned)
        assert result.joint_positions == pytest.approx(turned + 0.01, abs=1e-6)


@pytest.mark.parametrize(
    ("joint_box", "mode"),
    [
        (None, SolverMode.WHOLE_ROBOT),
        ({"slide": [0.0, 0.5], "turn": [-3.0, 3.0]}, SolverMode.WHOLE_ROBOT),
        ({"slide": [0.0, 0.4]}, SolverMode.REFINED),
        ({"turn": [0.5, 0.5]}, SolverMode.REFINED),
        ({"spin": [-3.0, 3.0]}, SolverMode.REFINED),
    ],
)
def test_a_robot_without_a_smaller_joint_box_is_whole(
    joint_box: dict[str, list[float]] | None, mode: SolverMode
) -> None:
    """Limits of two turns, and a continuous joint, have a box of one turn by default."""
    robot = load_robot(
        urdf(
            ["base", "a", "b", "c", "tip"],
            joint("slide", "base", "a", "prismatic", limit='lower="0" upper="0.5"'),
            joint("turn", "a", "b", limit='lower="-3" upper="3"'),
            joint("turns", "b", "c", limit='lower="-6.3" upper="6.3"'),
            joint("spin", "c", "tip", "continuous", limit='lower="-1" upper="1"'),
        ),
        joint_box=joint_box,
    )
    assert SolverMode.AUTO.of(robot) is mode
    for asked in set(SolverMode) - {SolverMode.AUTO}:
        assert asked.of(robot) is asked
