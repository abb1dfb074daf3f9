"""Solutions of whole robots are found and verified, and are the same in C++ and NumPy."""

import numpy as np
import pytest
from scipy.stats import qmc

from annik_core.kernel import compiled_kernel
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.solver.plain_search import PlainSearch
from annik_core.solver.result import RefinementOptions
from annik_core.solver.search import Search, SearchOptions
from annik_core.solver.whole_robot import readable_search, search_for

ARMS = ("panda", "puma560", "scara", "ur5e", "xarm6")
OPTIONS = SearchOptions()
SPACING = OPTIONS.spacing


def drawn(robot: Robot, count: int, seed: int = 1) -> FloatArray:
    """Joint positions within the limits, at most half a turn from their middle."""
    limits = robot.joint_limits
    middle = limits.centre
    lower, upper = (
        np.maximum(limits.lower, middle - np.pi),
        np.minimum(limits.upper, middle + np.pi),
    )
    return np.random.default_rng(seed).uniform(lower, upper, (count, robot.dof))


def no_starts(robot: Robot) -> FloatArray:
    return np.zeros((0, robot.dof))


def distances(robot: Robot, found: FloatArray, wanted: FloatArray) -> FloatArray:
    """Of solutions ``(n, dof)`` from one, full turns apart the same."""
    away = found - wanted
    turns = np.array([kind != "prismatic" for kind in robot.joint_types])
    away[:, turns] -= 2.0 * np.pi * np.round(away[:, turns] / (2.0 * np.pi))
    nearest: FloatArray = np.abs(away).max(axis=1)
    return nearest


@pytest.fixture(params=ARMS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


@pytest.fixture
def search(robot: Robot) -> Search:
    return search_for(robot, RefinementOptions())


class TestEveryArm:
    def test_every_pose_that_it_reaches_is_answered(self, robot: Robot, search: Search) -> None:
        for pose in robot.forward_kinematics.poses(drawn(robot, 100)):
            found = search.first(pose, no_starts(robot), OPTIONS.max_starts)
            assert found.found
            assert robot.joint_limits.contains(found.joint_positions)
            reached = robot.forward_kinematics.residuals(found.joint_positions, pose)
            assert reached == pytest.approx((found.position_residual, found.orientation_residual))
            assert max(reached) < 1e-6

    def test_the_solution_that_a_pose_was_made_from_is_among_all(
        self, robot: Robot, search: Search
    ) -> None:
        joint_positions = drawn(robot, 60)
        poses = robot.forward_kinematics.poses(joint_positions)
        missed = 0
        for made_from, pose in zip(joint_positions, poses, strict=True):
            found = search.all(pose, no_starts(robot), OPTIONS.max_starts, SPACING)
            assert len(found.joint_positions)
            for one, position, orientation in zip(*found[:3], strict=True):
                assert robot.joint_limits.contains(one)
                reached = robot.forward_kinematics.residuals(one, pose)
                assert reached == pytest.approx((position, orientation), abs=1e-12)
                assert max(reached) < 1e-6
            if robot.dof <= 6:
                missed += distances(robot, found.joint_positions, made_from).min() > 1e-3
        assert missed <= 1

    def test_a_joint_at_its_limit(self, robot: Robot, search: Search) -> None:
        """As at a home position: rounding may not make it a joint beyond its limit."""
        joint_positions = drawn(robot, 20)
        joint_positions[::2, 1] = robot.joint_limits.upper[1]
        joint_positions[1::2, 2] = robot.joint_limits.lower[2]
        poses = robot.forward_kinematics.poses(joint_positions)
        for made_from, pose in zip(joint_positions, poses, strict=True):
            assert search.first(pose, no_starts(robot), OPTIONS.max_starts).found
            found = search.all(pose, no_starts(robot), OPTIONS.max_starts, SPACING).joint_positions
            assert all(map(robot.joint_limits.contains, found))
            if robot.dof <= 6:
                assert distances(robot, found, made_from).min() < 1e-3

    def test_no_solution_is_listed_twice(self, robot: Robot, search: Search) -> None:
        for pose in robot.forward_kinematics.poses(drawn(robot, 20)):
            found = search.all(pose, no_starts(robot), OPTIONS.max_starts, SPACING).joint_positions
            for index, one in enumerate(found[1:], start=1):
                assert distances(robot, found[:index], one).min() > 1e-4

    def test_a_start_at_a_solution_is_the_first(self, robot: Robot, search: Search) -> None:
        joint_positions = drawn(robot, 20)
        for start, pose in zip(
            joint_positions, robot.forward_kinematics.poses(joint_positions), strict=True
        ):
            found = search.first(pose, start[np.newaxis], OPTIONS.max_starts)
            assert found.effort == 1
            assert found.joint_positions == pytest.approx(start, abs=1e-6)

    def test_a_pose_out_of_reach_has_none(self, robot: Robot, search: Search) -> None:
        pose = np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        assert not search.first(pose, no_starts(robot), 200).found
        assert search.first(pose, no_starts(robot), 200).effort <= 200
        assert len(search.all(pose, no_starts(robot), 200, SPACING).joint_positions) == 0

    def test_the_same_question_has_the_same_answer(self, robot: Robot, search: Search) -> None:
        again = search_for(load_robot(robot.name), RefinementOptions())
        assert again is not search
        for pose in robot.forward_kinematics.poses(drawn(robot, 5)):
            first, second = (
                way.all(pose, no_starts(robot), OPTIONS.max_starts, SPACING)
                for way in (search, again)
            )
            assert np.array_equal(first.joint_positions, second.joint_positions)


@pytest.mark.parametrize(("name", "found_by_the_target"), [("ur5e", {0, 5}), ("scara", {0, 3})])
def test_examples_are_a_halton_sequence(name: str, found_by_the_target: set[int]) -> None:
    """Of the joints that a target does not find by itself."""
    robot = load_robot(name)
    examples = readable_search(robot, RefinementOptions(), 200)._examples  # type: ignore[attr-defined]
    low, high = robot.joint_limits.lower, robot.joint_limits.upper
    width = np.where(robot.rotary, np.minimum(high - low, 2.0 * np.pi), high - low)
    spread = (examples - robot.joint_limits.centre) / width + 0.5
    others = [joint for joint in range(robot.dof) if joint not in found_by_the_target]
    expected = qmc.Halton(len(others), scramble=False).random(201)[1:]
    assert spread[:, others] == pytest.approx(expected, abs=1e-12)
    assert spread[:, list(found_by_the_target)] == pytest.approx(0.5)


class TestFollow:
    def test_a_short_way_leads_back(self, robot: Robot, search: Search) -> None:
        """A joint motion that is small is found again, where no joint can move beside it."""
        starts = 0.9 * (drawn(robot, 100) - robot.joint_limits.centre) + robot.joint_limits.centre
        ends = starts + 0.01 * np.random.default_rng(2).normal(size=starts.shape)
        ends = np.clip(ends, robot.joint_limits.lower, robot.joint_limits.upper)
        arrived = 0
        for start, end, pose in zip(
            starts, ends, robot.forward_kinematics.poses(ends), strict=True
        ):
            found = search.follow(start, pose)
            arrived += found.found
            if found.found:
                assert robot.joint_limits.contains(found.joint_positions)
                assert found.position_residual < 1e-6
                if robot.dof <= 6 and np.abs(found.joint_positions - end).max() > 1e-3:
                    # Another end is nearer to the start than a singularity that both are near.
                    assert np.abs(found.joint_positions - start).max() < 0.5
        assert arrived >= 97

    def test_it_ends_at_a_limit(self) -> None:
        """The end effector turns about the last axis, beyond the limit of the last joint."""
        robot = load_robot("xarm6")
        search = search_for(robot, RefinementOptions())
        start = robot.joint_box.centre.copy()
        start[5] = robot.joint_limits.upper[5] - 0.1
        end = start.copy()
        end[5] += 0.3
        pose = robot.forward_kinematics.poses(end[np.newaxis])[0]
        found = search.follow(start, pose)
        assert not found.found
        assert found.orientation_residual == pytest.approx(0.2, abs=0.02)
        assert robot.joint_limits.contains(found.joint_positions)

    def test_it_stays_where_it_is(self, robot: Robot) -> None:
        """At a singularity, what rounding leaves of an error could turn some joints far."""
        searches = [
            search_for(robot, RefinementOptions()),
            readable_search(robot, RefinementOptions(), 10),
        ]
        limits, rng = robot.joint_limits, np.random.default_rng(5)
        starts = drawn(robot, 20, seed=5)
        at_zero = np.clip(0.0, limits.lower, limits.upper)
        starts = np.where(rng.random(starts.shape) < 0.6, at_zero, starts)
        poses = robot.forward_kinematics.poses(starts)
        for search in searches:
            for start, pose in zip(starts, poses, strict=True):
                near = pose + 1e-8 * rng.normal(size=7)
                for target in (pose, near):
                    found = search.follow(start, target)
                    assert found.found
                    assert found.joint_positions == pytest.approx(start, abs=2e-4)

    @pytest.mark.parametrize("arm", ["ur5e", "xarm6", "puma560"])
    def test_close_to_a_singularity_joints_do_not_spin(self, arm: str) -> None:
        """A near target is left rather than reached by a motion that its ends do not need."""
        robot, rng = load_robot(arm), np.random.default_rng(3)
        search, kinematics = search_for(robot, RefinementOptions()), robot.forward_kinematics
        arrived = left = 0
        for start in drawn(robot, 200, seed=4):
            start[4] = rng.normal(scale=0.02)  # the wrist is nearly straight
            pose = kinematics.poses((start + rng.normal(scale=0.03, size=6))[np.newaxis])[0]
            found = search.follow(start, pose)
            left += not found.found
            if not found.found:
                continue
            arrived += 1
            motion = np.abs(found.joint_positions - start).max()
            begin = kinematics.poses(start[np.newaxis])[0]
            needed = [
                np.abs(np.linalg.pinv(linear.jacobian, rcond=1e-6) @ linear.twist).max()
                for linear in (
                    kinematics.linearise(start, pose),
                    kinematics.linearise(found.joint_positions, begin),
                )
            ]
            assert motion <= 1.5 * max(needed) + 2e-3
        assert arrived > 50
        assert left > 0

    def test_a_branch_is_another_beyond_a_singularity(self) -> None:
        robot = load_robot("ur5e")
        search = search_for(robot, RefinementOptions())
        start = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
        elbow_down = start.copy()
        elbow_down[2] = -1.5
        assert not search.same_branch(start, elbow_down)
        assert search.same_branch(start, start + 0.1)
        stretched = start * [1.0, 1.0, 0.0, 1.0, 1.0, 1.0]
        assert search.same_branch(stretched, start)


class TestPlainAndCompiled:
    """The readable search and the kernel's are the same."""

    pytestmark = pytest.mark.skipif(compiled_kernel() is None, reason="the kernel is not compiled")

    @pytest.mark.parametrize("name", ["puma560", "scara", "ur5e"])
    def test_the_same_solutions_in_the_same_order(
        self, name: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        robot = load_robot(name)
        monkeypatch.setattr("annik_core.solver.whole_robot.EXAMPLES", 3000)
        options = RefinementOptions()
        compiled, plain = search_for(robot, options), readable_search(robot, options, 3000)
        assert not isinstance(compiled, PlainSearch)
        joint_positions = drawn(robot, 6)
        joint_positions[:2, 1] = robot.joint_limits.upper[1]
        nearby = joint_positions + 0.02
        for pose, start, goal in zip(
            robot.forward_kinematics.poses(joint_positions),
            joint_positions,
            robot.forward_kinematics.poses(nearby),
            strict=True,
        ):
            first, second = (
                way.all(pose, no_starts(robot), OPTIONS.max_starts, SPACING)
                for way in (compiled, plain)
            )
            assert first.starts == second.starts
            assert first.joint_positions == pytest.approx(second.joint_positions, abs=1e-9)
            one, other = (
                way.first(pose, no_starts(robot), OPTIONS.max_starts) for way in (compiled, plain)
            )
            assert one.effort == other.effort
            assert one.joint_positions == pytest.approx(other.joint_positions, abs=1e-9)
            here, there = (way.follow(start, goal) for way in (compiled, plain))
            assert (here.found, here.effort) == (there.found, there.effort)
            assert here.joint_positions == pytest.approx(there.joint_positions, abs=1e-9)
            assert compiled.same_branch(start, nearby[0]) == plain.same_branch(start, nearby[0])

    def test_redundant_arms_are_answered_alike(self) -> None:
        robot = load_robot("panda")
        plain = readable_search(robot, RefinementOptions(), 3000)
        for pose in robot.forward_kinematics.poses(drawn(robot, 4)):
            found = plain.first(pose, no_starts(robot), OPTIONS.max_starts)
            assert found.found
            assert max(robot.forward_kinematics.residuals(found.joint_positions, pose)) < 1e-6
