"""Arms: their definition, working box, kinematics and workspace. ROS-free."""

from __future__ import annotations

import json
import math
import warnings
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support.refused_definition import refused_definition
from support.urdf_texts import DECLARATION, J1, J2, TWO_JOINTS, joint, planar_arm, urdf

from annik_core.errors import WrongShape
from annik_core.pose import FloatArray, pose_difference
from annik_core.robots.library import load_robot, packaged_robots, robot_from_definition
from annik_core.robots.robot import ForwardKinematics, Robot
from annik_core.robots.urdf_joint import CONTINUOUS_LIMIT

ARMS = tuple(name for name in packaged_robots() if name != "gantry")
CONTINUOUS = urdf("abc", J1, joint("j2", "b", "c", "continuous", limit=""))
PRISMATIC = urdf("abc", J1, joint("j2", "b", "c", "prismatic", limit='lower="-0.5" upper="0.2"'))


@cache
def arm_named(name: str) -> Robot:
    """Not a fixture: hypothesis would print all of it with a failing example."""
    return load_robot(name)


@pytest.fixture(params=ARMS)
def arm(request: pytest.FixtureRequest) -> Robot:
    return arm_named(request.param)


def anywhere(robot: Robot, count: int) -> FloatArray:
    """Joint positions anywhere within the limits."""
    limits = robot.joint_limits
    return np.random.default_rng(1).uniform(limits.lower, limits.upper, (count, robot.dof))


def refused(source: str, *named: str, **options: object) -> None:
    refused_definition(lambda: load_robot(source, **options), *named)


def refused_entries(entries: dict[str, object], *named: str) -> None:
    refused_definition(lambda: robot_from_definition({"kind": "arm", **entries}, "test"), *named)


class TestJointBox:
    """Where an arm works: inside its limits, and nowhere more than a turn."""

    def test_is_the_limits_where_nothing_is_said(self) -> None:
        robot = load_robot(PRISMATIC)
        assert robot.joint_types == ("revolute", "prismatic")
        for bounds in (robot.joint_box, robot.joint_limits):
            assert (bounds.lower.tolist(), bounds.upper.tolist()) == ([-1, -0.5], [1, 0.2])

    def test_is_what_is_given_joint_by_joint(self) -> None:
        box = load_robot(TWO_JOINTS, joint_box={"j2": (-0.25, 1)}).joint_box
        assert (box.lower.tolist(), box.upper.tolist()) == ([-1, -0.25], [1, 1])

    def test_of_a_definition_is_changed_joint_by_joint(self) -> None:
        known = load_robot("panda").joint_box
        robot = load_robot("panda", joint_box={"panda_joint3": [0.25, 0.25]})
        assert robot.joint_box.lower.tolist() == [*known.lower[:2], 0.25, *known.lower[3:]]
        assert robot.joint_box.upper.tolist() == [*known.upper[:2], 0.25, *known.upper[3:]]

    def test_of_a_continuous_joint_is_one_turn(self) -> None:
        robot = load_robot(CONTINUOUS)
        assert robot.joint_limits.upper[1] == -robot.joint_limits.lower[1] == CONTINUOUS_LIMIT
        assert robot.joint_box.upper[1] == -robot.joint_box.lower[1] == math.pi

    @pytest.mark.parametrize("bounds", [(-6.25, 0.0), (5.0, 7.0), (100.0, 100.0)])
    def test_of_a_continuous_joint_may_be_in_any_turn(self, bounds: tuple[float, float]) -> None:
        box = load_robot(CONTINUOUS, joint_box={"j2": bounds}).joint_box
        assert (box.lower[1], box.upper[1]) == bounds

    @pytest.mark.parametrize(
        ("lower", "upper", "expected"),
        [
            (-2 * math.pi, 2 * math.pi, (-math.pi, math.pi)),
            (-1, 8, (3.5 - math.pi, 3.5 + math.pi)),
        ],
    )
    def test_of_wide_limits_is_the_turn_in_their_middle(
        self, lower: float, upper: float, expected: tuple[float, float]
    ) -> None:
        limit = f'lower="{lower!r}" upper="{upper!r}"'
        robot = load_robot(urdf("abc", J1, joint("j2", "b", "c", limit=limit)))
        assert (robot.joint_box.lower[1], robot.joint_box.upper[1]) == expected
        assert (robot.joint_limits.lower[1], robot.joint_limits.upper[1]) == (lower, upper)

    def test_of_a_long_axis_may_be_as_long(self) -> None:
        """Only angles repeat."""
        limit = 'lower="-10" upper="10"'
        robot = load_robot(urdf("abc", J1, joint("j2", "b", "c", "prismatic", limit=limit)))
        assert robot.joint_box.upper[1] == 10

    def test_wider_than_a_turn_is_refused(self) -> None:
        refused(CONTINUOUS, "joint_box of j2", "full turn", joint_box={"j2": [-4, 4]})

    @pytest.mark.parametrize("bounds", [[-1.1, 0], [0, 1.1], [2, 3]])
    def test_outside_the_limits_is_refused(self, bounds: list[float]) -> None:
        refused(TWO_JOINTS, "joint_box of j1", "[-1, 1]", joint_box={"j1": bounds})

    @pytest.mark.parametrize("kind", ["revolute", "continuous"])
    def test_of_more_than_a_turn_is_refused(self, kind: str) -> None:
        text = urdf("abc", J1, joint("j2", "b", "c", kind, limit='lower="-9" upper="9"'))
        refused(text, "joint_box of j2", "full turn", joint_box={"j2": [0.0, 6.3]})

    def test_that_is_the_limits_is_the_full_turn_in_their_middle(self) -> None:
        """What annik robot shows as the limits can be given as the box."""
        text = urdf("abc", J1, joint("j2", "b", "c", limit='lower="-9" upper="8"'))
        boxes = [load_robot(text, joint_box=box).joint_box for box in (None, {"j2": [-9, 8]})]
        assert boxes[1].lower.tolist() == boxes[0].lower.tolist()
        assert boxes[1].upper.tolist() == boxes[0].upper.tolist()

    @pytest.mark.parametrize(
        ("box", "named"),
        [
            ({"j9": [0, 1]}, ["joint_box", "'j9'", "j1, j2"]),
            ({"j1": [0.5, 0.0]}, ["joint_box of j1", "[0.5, 0.0]", "[lower, upper]"]),
            ({"j1": [0]}, ["joint_box of j1", "[lower, upper]"]),
            ({"j1": [0, 0, 0]}, ["joint_box of j1", "[lower, upper]"]),
            ({"j1": 0.5}, ["joint_box of j1", "[lower, upper]"]),
            ({"j1": [math.nan, 0]}, ["j1", "finite"]),
            ({"j1": [0, math.inf]}, ["j1", "finite"]),
            ({"j1": ["0", "1x"]}, ["joint_box of j1", "1x", "deg"]),
            ({"j1": ["0", "5mm"]}, ["joint_box of j1", "5mm", "deg"]),
            ({"j1": [True, 1]}, ["joint_box of j1", "text"]),
            ({"j1": None}, ["joint_box of j1"]),
            ({"j1": [0, 10**400]}, ["joint_box of j1", "malformed"]),
            ([[0, 1], [0, 1]], ["joint_box", "mapping"]),
            ({"j1": [0, 0], "j2": [1, 1]}, ["joint_box", "every joint"]),
        ],
    )
    def test_that_makes_no_sense_is_refused(self, box: object, named: list[str]) -> None:
        refused(TWO_JOINTS, *named, joint_box=box)

    @pytest.mark.parametrize("at", [-1.0, 0.0, 0.3, 1.0])
    def test_of_no_width_locks_a_joint(self, at: float) -> None:
        box = load_robot(TWO_JOINTS, joint_box={"j1": [at, at]}).joint_box
        assert box.lower[0] == box.upper[0] == at

    def test_of_limits_of_no_width_locks_a_joint(self) -> None:
        fixed = joint("j2", "b", "c", limit='lower="0.5" upper="0.5"')
        box = load_robot(urdf("abc", J1, fixed)).joint_box
        assert box.lower[1] == box.upper[1] == 0.5
        refused(urdf("bc", fixed), "locks every joint")

    def test_is_for_arms_only(self) -> None:
        for option in ({"joint_box": {}}, {"base_frame": "a"}, {"end_effector_frame": "a"}):
            refused("gantry", f"{next(iter(option))} can be given for an arm only", **option)


class TestDefinition:
    """What a model file carries is enough to have the same robot again."""

    @pytest.mark.parametrize("source", [*ARMS, TWO_JOINTS, CONTINUOUS, PRISMATIC, planar_arm()])
    def test_gives_the_same_robot_again(self, source: str) -> None:
        robot = load_robot(source)
        carried = json.loads(json.dumps(robot.definition))
        assert carried == robot.definition
        again = robot_from_definition(carried, "test")
        assert again.definition == robot.definition
        assert again.definition_hash == robot.definition_hash
        for name in ("joint_limits", "joint_box"):
            one, other = getattr(robot, name), getattr(again, name)
            assert one.lower.tobytes() == other.lower.tobytes()
            assert one.upper.tobytes() == other.upper.tobytes()
        q = anywhere(robot, 20)
        one, other = robot.forward_kinematics, again.forward_kinematics
        assert one.poses(q).tobytes() == other.poses(q).tobytes()
        assert one.jacobians(q).tobytes() == other.jacobians(q).tobytes()

    def test_does_not_depend_on_what_does_not_move_the_end_effector(self) -> None:
        plain = load_robot(TWO_JOINTS)
        visual = '<visual><geometry><mesh filename="arm.stl" scale="1 1 1"/></geometry></visual>'
        other = urdf("zcyba", joint("g1", "b", "z"), J2, joint("g2", "a", "y", "floating"), J1)
        other = other.replace('<link name="b"/>', f'<link name="b">{visual}</link>')
        other = DECLARATION + other.replace("><", ">\n  <")
        again = load_robot(other, end_effector_frame="c")
        assert again.definition_hash == plain.definition_hash
        assert again.definition_hash != load_robot(other, end_effector_frame="z").definition_hash

    @pytest.mark.parametrize(
        "other",
        [
            urdf("abc", J1, joint("j2", "b", "c", origin='xyz="0.1 -0.2 0.30000000000000004"')),
            urdf("abc", J1, joint("j2", "b", "c", axis='xyz="0 0 -1"')),
            urdf("abc", J1, joint("j2", "b", "c", limit='lower="-1" upper="1.0000000000000002"')),
            urdf("abc", J1, joint("other", "b", "c")),
            urdf("abd", J1, joint("j2", "b", "d")),
        ],
        ids=["origin", "axis", "limit", "joint's name", "frame's name"],
    )
    def test_tells_arms_apart(self, other: str) -> None:
        assert load_robot(other).definition_hash != load_robot(TWO_JOINTS).definition_hash

    def test_tells_boxes_apart(self) -> None:
        boxed = load_robot(TWO_JOINTS, joint_box={"j1": [-1, 0.5]})
        assert boxed.definition_hash != load_robot(TWO_JOINTS).definition_hash
        same = load_robot(TWO_JOINTS, joint_box={"j1": [-1, 1]})
        assert same.definition_hash == load_robot(TWO_JOINTS).definition_hash

    def test_with_an_unknown_entry_is_refused(self) -> None:
        """It may be the slip of a pen, such as joint_boxes."""
        refused_entries({"urdf": TWO_JOINTS, "joint_boxes": {}}, "'joint_boxes'", "joint_box,")

    @pytest.mark.parametrize("text", [None, 3, ["<robot/>"]])
    def test_without_a_urdf_is_refused(self, text: object) -> None:
        refused_entries({"urdf": text}, "'urdf'", "missing")

    @pytest.mark.parametrize("key", ["base_frame", "end_effector_frame"])
    @pytest.mark.parametrize("name", ["", " ", 7, "a\nb"])
    def test_with_a_frame_that_is_no_name_is_refused(self, key: str, name: object) -> None:
        refused_entries({"urdf": TWO_JOINTS, key: name}, key, repr(name))

    def test_frames_can_be_changed(self) -> None:
        whole = load_robot("ur5e")
        part = load_robot(TWO_JOINTS, base_frame="b", end_effector_frame="c")
        assert (part.base_frame, part.end_effector_frame) == ("b", "c")
        assert part.joint_names == ("j2",)
        refused("ur5e", "end_effector_frame", "'nowhere'", end_effector_frame="nowhere")
        again = load_robot("ur5e", base_frame=whole.base_frame)
        assert again.definition_hash == whole.definition_hash


class TestKinematics:
    """Poses, errors and Jacobians agree with each other and with the arithmetic of poses."""

    def test_poses_have_unit_quaternions_with_w_not_negative(self, arm: Robot) -> None:
        poses = arm.forward_kinematics.poses(anywhere(arm, 2000))
        assert (poses[:, 6] >= 0).all()
        assert np.linalg.norm(poses[:, 3:], axis=1) == pytest.approx(np.ones(2000), abs=1e-14)

    @pytest.mark.parametrize("count", [0, 1, 5])
    def test_a_batch_is_its_rows(self, arm: Robot, count: int) -> None:
        q, kinematics = anywhere(arm, count), arm.forward_kinematics
        poses, jacobians = kinematics.poses(q), kinematics.jacobians(q)
        assert poses.shape == (count, 7)
        assert jacobians.shape == (count, 6, arm.dof)
        for row in range(count):
            assert np.array_equal(kinematics.poses(q[row : row + 1])[0], poses[row])
            assert np.array_equal(kinematics.jacobians(q[row : row + 1])[0], jacobians[row])

    @pytest.mark.parametrize("shape", [(2,), (1, 1), (1, 3), (2, 2, 2), (0,)])
    def test_wrong_joint_count_names_the_joints(self, shape: tuple[int, ...]) -> None:
        kinematics = load_robot(TWO_JOINTS).forward_kinematics
        for function in (kinematics.poses, kinematics.jacobians):
            with pytest.raises(WrongShape) as caught:
                function(np.zeros(shape))
            assert caught.value.shape == shape
            assert "j1, j2" in caught.value.expected

    def test_the_error_is_the_pose_difference(self, arm: Robot) -> None:
        """Everywhere in its distances, near the target in its twist."""
        rng = np.random.default_rng(2)
        q = anywhere(arm, 100)
        for start, goal in zip(q, q + rng.normal(scale=1e-4, size=q.shape), strict=True):
            for far in (goal, rng.permutation(q)[0]):
                target, achieved = arm.forward_kinematics.poses(np.array([far, start]))
                position, rotation = pose_difference(target, achieved)
                error = arm.forward_kinematics.linearise(start, target)
                distance, angle = error.residuals
                assert distance == pytest.approx(np.linalg.norm(position), abs=1e-12)
                assert angle == pytest.approx(np.linalg.norm(rotation), abs=1e-9)
                assert np.linalg.norm(error.twist[3:]) == pytest.approx(angle)
                if far is goal:
                    length = np.linalg.norm(error.twist[:3])
                    assert length == pytest.approx(np.linalg.norm(position), rel=1e-6, abs=1e-12)

    @given(st.floats(0, math.pi), st.floats(-1, 1), st.floats(0, 2 * math.pi))
    def test_the_angle_of_the_error_is_right_up_to_half_a_turn(
        self, angle: float, height: float, azimuth: float
    ) -> None:
        robot = arm_named("ur5e")
        q = robot.joint_box.centre
        target = robot.forward_kinematics.poses(q[None])[0]
        level = math.sqrt(1 - height * height)
        axis = np.array([level * math.cos(azimuth), level * math.sin(azimuth), height])
        turned = Rotation.from_rotvec(angle * axis) * Rotation.from_quat(target[3:])
        target[3:] = turned.as_quat()
        for sign in (1, -1):
            target[3:] *= sign
            distance, found = robot.forward_kinematics.linearise(q, target).residuals
            assert found == pytest.approx(angle, abs=1e-7)
            assert distance < 1e-12

    def test_the_jacobian_of_the_error_matches_finite_differences(self, arm: Robot) -> None:
        """At the target, where the twist is what the joints' motion takes off."""
        step = 1e-6
        for q in anywhere(arm, 20):
            kinematics = arm.forward_kinematics
            target = kinematics.poses(q[None])[0]
            for index, column in enumerate(kinematics.linearise(q, target).jacobian.T):
                aside = step * np.eye(arm.dof)[index]
                before, after = (
                    kinematics.linearise(q + s, target).twist for s in (-aside, aside)
                )
                assert column == pytest.approx((before - after) / step / 2, abs=1e-7)

    def test_the_error_agrees_with_that_by_poses_and_jacobians(self, arm: Robot) -> None:
        """Both are in the axes of the end effector; only far off do the twists' lengths differ."""
        kinematics = arm.forward_kinematics
        for start, goal in anywhere(arm, 40).reshape(20, 2, -1):
            target = kinematics.poses(goal[None])[0]
            own = kinematics.linearise(start, target)
            plain = ForwardKinematics.linearise(kinematics, start, target)
            assert own.residuals == pytest.approx(plain.residuals, abs=1e-9)
            assert own.displacement == pytest.approx(plain.displacement, abs=1e-12)
            assert own.jacobian == pytest.approx(plain.jacobian, abs=1e-12)
            if plain.residuals[1] < math.pi - 1e-3:
                assert own.twist[3:] == pytest.approx(plain.twist[3:], abs=1e-9)

    def test_linearisations_do_not_disturb_each_other(self, arm: Robot) -> None:
        """Though they share Pinocchio's memory."""
        kinematics = arm.forward_kinematics
        q = anywhere(arm, 3)
        one, other = kinematics.poses(q[:2])
        kept = kinematics.linearise(q[2], one)
        copies = [array.copy() for array in (kept.twist, kept.jacobian, kept.displacement)]
        kinematics.linearise(q[0], other)
        kinematics.linearise(q[1], one)
        kinematics.poses(q)
        for again in (kept, kinematics.linearise(q[2], one)):
            found = (again.twist, again.jacobian, again.displacement)
            assert all(map(np.array_equal, found, copies))


class TestWorkspace:
    """It refuses only what no joint positions reach."""

    @settings(max_examples=60)
    @given(st.data())
    @pytest.mark.parametrize("name", ARMS)
    def test_holds_whatever_the_arm_reaches(self, name: str, data: st.DataObject) -> None:
        robot = arm_named(name)
        bounds = zip(robot.joint_limits.lower, robot.joint_limits.upper, strict=True)
        q = np.array([data.draw(st.floats(low, high)) for low, high in bounds])
        pose = robot.forward_kinematics.poses(q[None])[0]
        resolved = robot.workspace.resolve(pose, None)
        assert resolved.violation is None
        assert np.array_equal(resolved.pose, pose)

    def test_holds_many_poses_and_the_arm_stretched_out(self, arm: Robot) -> None:
        workspace = arm.workspace
        poses = arm.forward_kinematics.poses(anywhere(arm, 2000))
        distances = np.linalg.norm(poses[:, :3] - workspace.centre, axis=1)
        assert distances.max() <= workspace.reach
        assert workspace.reach < 2 * distances.max()  # and it is no empty promise

    @pytest.mark.parametrize("q", [[0, -0.5, 0], [0, 0.7, 0], [0, 0, -0.5], [0.2, 0.7, 0.2]])
    def test_counts_the_strokes_of_prismatic_joints(self, q: list[float]) -> None:
        """Of the first joint too, whose origin is the centre."""
        limit = 'lower="-0.5" upper="0.7"'
        robot = load_robot(
            urdf(
                "abcd",
                joint("turn", "a", "b", origin=""),
                joint("slide", "b", "c", "prismatic", origin='xyz="1 0 0"', limit=limit),
                joint("slip", "c", "d", "prismatic", origin="", limit=limit),
            )
        )
        pose = robot.forward_kinematics.poses(np.array([q]))[0]
        assert robot.workspace.resolve(pose, None).violation is None
        assert robot.workspace.reach == pytest.approx(1 + 0.7 + 0.7)
        first = load_robot(PRISMATIC, base_frame="b")
        pose = first.forward_kinematics.poses(first.joint_limits.lower[None])[0]
        assert first.workspace.resolve(pose, None).violation is None
        assert first.workspace.reach == pytest.approx(0.5)

    def test_names_the_distance_and_the_reach(self) -> None:
        workspace = load_robot(planar_arm()).workspace
        assert workspace.resolve(np.array([2.0, 0, 0, 0, 0, 0, 1]), None).violation is None
        violation = workspace.resolve(np.array([0, -2.01, 0, 0, 0, 0, 1]), None).violation
        assert violation is not None
        assert "2.01 m" in violation
        assert "2 m" in violation.split("2.01 m")[1]

    @pytest.mark.parametrize("far", [1e3, 1e200, 1.7e308])
    def test_refuses_any_distance_without_a_warning(self, arm: Robot, far: float) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for pose in ([far, 0, 0, 0, 0, 0, 1], [-far, far, -far, 0, 0, 0, 1]):
                assert arm.workspace.resolve(np.array(pose), None).violation is not None

    def test_remembers_nothing(self, arm: Robot) -> None:
        """An arm's solution depends on the pose alone."""
        assert len(arm.workspace.reference(arm.joint_box.centre)) == 0


def test_a_nearer_end_effector_keeps_the_box_of_the_joints_that_are_left() -> None:
    whole = load_robot("ur5e")
    nearer = load_robot("ur5e", end_effector_frame="wrist_1_link")
    assert nearer.joint_names == whole.joint_names[:4]
    assert np.array_equal(nearer.joint_box.lower, whole.joint_box.lower[:4])
