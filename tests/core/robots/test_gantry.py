"""The paper's robot against its equations, written out here in the paper's units. ROS-free."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refused_definition import refused_definition

from annik_core.errors import WrongShape
from annik_core.pose import pose_difference, pose_from_roll_pitch_yaw
from annik_core.robots.errors import UnknownRobot
from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.library import load_robot, packaged_robots, robot_from_definition
from annik_core.robots.robot import Robot

drive_angles_deg = st.lists(st.floats(20, 50), min_size=6, max_size=6)


def paper_direct_kinematics(q_deg: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """X, Y, Z [mm] and psi, theta, phi [degrees] by eq. (1)-(2) with (13)-(14)."""
    return q_deg[:3] * 10 + np.array([0, 0, 300]), q_deg[3:] * 3 - 60


def rotation_matrix(psi: float, theta: float, phi: float) -> np.ndarray:
    """Rotations about the fixed x, y and z axes, in this order, from the elementary matrices."""
    cx, sx = np.cos(psi), np.sin(psi)
    cy, sy = np.cos(theta), np.sin(theta)
    cz, sz = np.cos(phi), np.sin(phi)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def matrix_of_quaternion(x: float, y: float, z: float, w: float) -> np.ndarray:
    """The rotation matrix of a unit quaternion, from its textbook formula."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@given(drive_angles_deg)
def test_poses_are_those_of_the_papers_equations(gantry: Robot, q_deg: list[float]) -> None:
    """Equations (1)-(2), then rotations about x, y, z."""
    pose = gantry.forward_kinematics.poses(np.radians([q_deg]))[0]
    position_mm, angles_deg = paper_direct_kinematics(np.array(q_deg))
    assert pose[:3] * 1000 == pytest.approx(position_mm, abs=1e-9)
    expected = rotation_matrix(*np.radians(angles_deg))
    assert matrix_of_quaternion(*pose[3:]) == pytest.approx(expected, abs=1e-12)


@given(drive_angles_deg)
def test_inverse_undoes_direct_kinematics(gantry: Robot, q_deg: list[float]) -> None:
    """Equations (3)-(4) after (1)-(2) give the drive angles back."""
    kinematics = gantry.forward_kinematics
    assert isinstance(kinematics, GantryKinematics)
    q = np.radians([q_deg])
    assert kinematics.joint_positions(kinematics.task_coordinates(q)) == pytest.approx(
        q, abs=1e-12
    )


def test_the_printed_points_of_table_8(gantry: Robot) -> None:
    """Joint positions of 20, 35 and 50 degrees are 200/500, 350/650 and 500/800 mm; 0, 45, 90."""
    kinematics = gantry.forward_kinematics
    assert isinstance(kinematics, GantryKinematics)
    task = kinematics.task_coordinates(np.radians([[20.0] * 6, [35.0] * 6, [50.0] * 6]))
    assert task[:, :3] * 1000 == pytest.approx(
        np.array([[200, 200, 500], [350, 350, 650], [500, 500, 800]])
    )
    assert np.degrees(task[:, 3:]) == pytest.approx(
        np.array([[0, 0, 0], [45, 45, 45], [90, 90, 90]]), abs=1e-9
    )


@given(drive_angles_deg)
def test_jacobian_matches_finite_differences(gantry: Robot, q_deg: list[float]) -> None:
    """Column j is the twist that joint j causes."""
    kinematics = gantry.forward_kinematics
    q = np.radians(q_deg)
    step = 1e-6
    forth = kinematics.poses(q + step * np.eye(6))
    back = kinematics.poses(q - step * np.eye(6))
    linear, angular = pose_difference(forth, back)
    columns = np.hstack([linear, angular]) / (2 * step)
    assert pytest.approx(columns, abs=1e-7) == kinematics.jacobians(q[np.newaxis])[0].T


def test_a_batch_is_its_rows(gantry: Robot) -> None:
    """Each row of a batch is answered as if alone."""
    q = np.random.default_rng(0).uniform(0.35, 0.87, (5, 6))
    alone = [gantry.forward_kinematics.poses(row[np.newaxis])[0] for row in q]
    assert np.array_equal(gantry.forward_kinematics.poses(q), np.array(alone))


@pytest.mark.parametrize("shape", [(6,), (1, 5), (1, 7), (2, 3, 6)])
def test_wrong_joint_count_names_the_joints(gantry: Robot, shape: tuple[int, ...]) -> None:
    """Whatever is not (n, 6) is refused."""
    with pytest.raises(WrongShape) as caught:
        gantry.forward_kinematics.poses(np.zeros(shape))
    assert caught.value.shape == shape
    assert all(name in caught.value.expected for name in gantry.joint_names)


class TestWorkspace:
    """The workspace is the paper's: a cube of 300 mm, angles from 0 to 90 degrees."""

    @given(drive_angles_deg)
    def test_holds_what_the_joint_box_reaches(self, gantry: Robot, q_deg: list[float]) -> None:
        """No pose of the joint box is outside, edges included."""
        pose = gantry.forward_kinematics.poses(np.radians([q_deg]))[0]
        assert gantry.workspace.resolve(pose, None).violation is None

    @pytest.mark.parametrize(
        ("position", "angles", "named"),
        [
            ((0.199, 0.3, 0.6), (0.1, 0.1, 0.1), "x is 0.199"),
            ((0.3, 0.501, 0.6), (0.1, 0.1, 0.1), "y is 0.501"),
            ((0.3, 0.3, 0.2), (0.1, 0.1, 0.1), "z is 0.2"),
            ((0.3, 0.3, 0.6), (-0.1, 0.1, 0.1), "roll is -0.1"),
            ((0.3, 0.3, 0.6), (0.1, -0.1, 0.1), "pitch is -0.1"),
            ((0.3, 0.3, 0.6), (0.1, 0.1, 1.7), "yaw is 1.7"),
        ],
    )
    def test_names_what_is_outside(
        self,
        gantry: Robot,
        position: tuple[float, ...],
        angles: tuple[float, ...],
        named: str,
    ) -> None:
        """The refusal says which coordinate, its value and its range."""
        violation = gantry.workspace.resolve(
            pose_from_roll_pitch_yaw(position, angles), None
        ).violation
        assert violation is not None
        assert named in violation
        assert "workspace is [" in violation

    @pytest.mark.parametrize("axis", [3, 5], ids=["roll", "yaw"])
    @pytest.mark.parametrize("end", [0.0, np.pi / 2])
    def test_is_as_wide_as_rounding_makes_it_near_the_pitch_edge(
        self, gantry: Robot, axis: int, end: float
    ) -> None:
        """A micro-radian over the cosine of the pitch, for roll and yaw but not for the pitch."""
        outwards = 1.0 if end else -1.0
        for from_edge, beyond, inside in (
            (1e-3, 0.9e-3, True),
            (1e-3, 1.1e-3, False),
            (1e-2, 0.9e-4, True),
            (1e-2, 1.1e-4, False),
            (1.0, 0.9e-6, True),
            (1.0, 1.5e-6, False),
        ):
            task = np.array([0.3, 0.3, 0.6, 0.7, np.pi / 2 - from_edge, 0.7])
            task[axis] = end + outwards * beyond
            pose = pose_from_roll_pitch_yaw(task[:3], task[3:])
            violation = gantry.workspace.resolve(pose, None).violation
            assert (violation is None) == inside, (from_edge, beyond)
            if violation is not None:
                assert ("roll", "pitch", "yaw")[axis - 3] in violation
        pose = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], [0.7, -1e-5, 0.7])
        assert "pitch" in str(gantry.workspace.resolve(pose, None).violation)


class TestGimbalEdge:
    """At a pitch of 90 degrees roll and yaw are not unique."""

    @given(st.floats(0, 90), st.floats(0, 90))
    def test_stays_with_the_previous_command(
        self, gantry: Robot, roll_deg: float, yaw_deg: float
    ) -> None:
        """Previous joint positions on the edge are kept exactly when the pose is theirs."""
        kinematics = gantry.forward_kinematics
        assert isinstance(kinematics, GantryKinematics)
        angles = np.radians([roll_deg, 90.0, yaw_deg])
        task = np.concatenate([[0.3, 0.3, 0.6], angles])
        previous = kinematics.joint_positions(task[np.newaxis])[0]
        pose = kinematics.poses(previous[np.newaxis])[0]
        resolved = gantry.workspace.resolve(pose, gantry.workspace.reference(previous))
        assert resolved.violation is None
        expected = pose_from_roll_pitch_yaw(task[:3], [angles[0], angles[1] - 1e-7, angles[2]])
        position, rotation = pose_difference(expected, resolved.pose)
        assert np.linalg.norm(position) < 1e-12
        assert np.linalg.norm(rotation) < 1e-12

    @given(st.floats(0, 90), st.floats(0, 90), st.floats(-3e-6, 3e-6))
    def test_the_resolved_pose_is_the_target_within_20_microradians(
        self, gantry: Robot, roll_deg: float, yaw_deg: float, from_edge: float
    ) -> None:
        """Near the edge, on either side of it, without a previous command."""
        angles = [np.radians(roll_deg), np.pi / 2 - from_edge, np.radians(yaw_deg)]
        pose = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], angles)
        resolved = gantry.workspace.resolve(pose, None)
        assert resolved.violation is None
        _, rotation = pose_difference(pose, resolved.pose)
        assert np.linalg.norm(rotation) < 2e-5

    @given(st.sampled_from([0.0, 90.0]), st.sampled_from([0.0, 90.0]), st.data())
    def test_whatever_came_before_a_reachable_edge_pose_is_inside(
        self, gantry: Robot, roll_deg: float, yaw_deg: float, data: st.DataObject
    ) -> None:
        """From corner to corner, with a quaternion that is rounded as any is."""
        limits = gantry.joint_limits
        bounds = zip(limits.lower, limits.upper, strict=True)
        previous = np.array([data.draw(st.floats(low, high)) for low, high in bounds])
        position = [data.draw(st.floats(0.2, 0.5)), 0.3, 0.6]
        pose = pose_from_roll_pitch_yaw(position, np.radians([roll_deg, 90.0, yaw_deg]))
        resolved = gantry.workspace.resolve(pose, gantry.workspace.reference(previous))
        assert resolved.violation is None

    def test_holding_a_pose_never_creeps(self, gantry: Robot) -> None:
        """The reference of one answer, given with the next target, is kept to rounding."""
        angles = np.radians([20.0, 90.0, 70.0])
        pose = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], angles)
        reference = angles
        for _ in range(10_000):
            reference = gantry.workspace.resolve(pose, reference).reference
        assert reference[[0, 2]] == pytest.approx(angles[[0, 2]], abs=1e-9)

    @given(st.floats(89, 90), st.sampled_from([0.0, 90.0]), st.sampled_from([0.0, 90.0]))
    def test_a_quaternion_in_single_precision_is_no_reason_to_refuse(
        self, gantry: Robot, pitch_deg: float, roll_deg: float, yaw_deg: float
    ) -> None:
        """On the faces of the workspace, however close to the edge."""
        pose = pose_from_roll_pitch_yaw(
            [0.3, 0.3, 0.6], np.radians([roll_deg, pitch_deg, yaw_deg])
        )
        rounded = pose.copy()
        rounded[3:] = pose[3:].astype(np.float32)
        rounded[3:] /= np.linalg.norm(rounded[3:])
        assert gantry.workspace.resolve(rounded, None).violation is None

    @given(st.floats(-90, 0), st.floats(0, 90))
    def test_the_edge_on_the_other_side(
        self, gantry: Robot, roll_deg: float, yaw_deg: float
    ) -> None:
        """At -90 degrees the sum of roll and yaw turns the end effector, not the difference."""
        joints = [dict(joint) for joint in gantry.definition["joints"]]
        joints[3]["offset"] = np.radians(-150.0)
        joints[4]["offset"] = np.radians(-150.0)
        other = robot_from_definition({**gantry.definition, "joints": joints}, "test")
        angles = np.radians([roll_deg, -90.0, yaw_deg])
        pose = pose_from_roll_pitch_yaw([0.3, 0.3, 0.6], angles)
        resolved = other.workspace.resolve(pose, angles)
        assert resolved.violation is None
        assert resolved.reference[[0, 2]] == pytest.approx(angles[[0, 2]], abs=1e-9)
        _, rotation = pose_difference(pose, resolved.pose)
        assert np.linalg.norm(rotation) < 2e-5


def refused(definition: Mapping[str, object], *named: str) -> None:
    refused_definition(lambda: robot_from_definition(definition, "test"), *named)


class TestDefinition:
    """A faulty definition is refused with what is wrong in it."""

    @pytest.mark.parametrize(
        ("change", "named"),
        [
            ({"kind": "octopus"}, ["'octopus'", "arm", "gantry"]),
            ({"joints": None}, ["malformed"]),
            ({"joints": []}, ["six joints"]),
            ({"base_frame": ...}, ["'base_frame'", "missing"]),
        ],
    )
    def test_top_level(self, gantry: Robot, change: dict[str, object], named: list[str]) -> None:
        """A missing or malformed entry is named."""
        definition = {**gantry.definition, **change}
        definition = {key: value for key, value in definition.items() if value is not ...}
        refused(definition, *named)

    @pytest.mark.parametrize(
        ("change", "named"),
        [
            ({"ratio": 0.0}, ["ratio", "not 0"]),
            ({"ratio": float("nan")}, ["ratio", "finite"]),
            ({"limits": [1.0, 0.0]}, ["limit", "1.0", "0.0"]),
            ({"limits": [0.0, float("inf")]}, ["limits", "finite"]),
            ({"box": [0.0, 9.0]}, ["box", "limits"]),
            ({"name": "y_drive_joint"}, ["unique", "y_drive_joint"]),
        ],
    )
    def test_joints(self, gantry: Robot, change: dict[str, object], named: list[str]) -> None:
        """A joint that makes no sense is refused."""
        joints = [dict(joint) for joint in gantry.definition["joints"]]
        joints[0].update(change)
        refused({**gantry.definition, "joints": joints}, *named)

    def test_pitch_beyond_the_edge(self, gantry: Robot) -> None:
        """Beyond 90 degrees of pitch no pose has one roll and yaw."""
        joints = [dict(joint) for joint in gantry.definition["joints"]]
        joints[4]["box"] = [0.35, 0.9]
        refused({**gantry.definition, "joints": joints}, "pitch", "90")

    def test_unknown_robot_lists_the_known(self) -> None:
        """A name that is none is answered with those that are."""
        assert "gantry" in packaged_robots()
        with pytest.raises(UnknownRobot) as caught:
            load_robot("octopus")
        assert caught.value.name == "octopus"
        assert sorted(caught.value.known) == sorted(packaged_robots())

    def test_hash_tells_robots_apart(self, gantry: Robot) -> None:
        """Equal definitions have equal hashes, others not."""
        other = robot_from_definition({**gantry.definition, "base_frame": "world"}, "test")
        assert load_robot("gantry").definition_hash == gantry.definition_hash
        assert other.definition_hash != gantry.definition_hash
