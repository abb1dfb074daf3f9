"""A robot as a URDF, and the poses of its links. Needs no ROS."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from annik_core.robots.description import link_poses, robot_urdf
from annik_core.robots.library import load_robot, packaged_robots
from annik_core.robots.robot import Robot

every_robot = pytest.mark.parametrize("name", packaged_robots())


def poses_by_urdf(robot: Robot, joint_positions: np.ndarray) -> dict[str, np.ndarray]:
    """Homogeneous poses of all links, as robot_state_publisher computes them from the URDF."""
    positions = dict(zip(robot.joint_names, joint_positions, strict=True))
    poses = {robot.base_frame: np.eye(4)}
    for joint in ElementTree.fromstring(robot_urdf(robot)).iter("joint"):
        parts = {part.tag: part.attrib for part in joint}
        origin, motion = np.eye(4), np.eye(4)
        origin[:3, 3] = np.array(parts["origin"]["xyz"].split(), float)
        angles = np.array(parts["origin"]["rpy"].split(), float)
        origin[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        if joint.attrib["type"] != "fixed":
            mimic = parts.get("mimic", {"joint": joint.attrib["name"]})
            driver = positions[mimic["joint"]]
            position = float(mimic.get("multiplier", 1)) * driver + float(mimic.get("offset", 0))
            moved = position * np.array(parts["axis"]["xyz"].split(), float)
            if joint.attrib["type"] == "prismatic":
                motion[:3, 3] = moved
            else:
                motion[:3, :3] = Rotation.from_rotvec(moved).as_matrix()
        poses[parts["child"]["link"]] = poses[parts["parent"]["link"]] @ origin @ motion
    return poses


def homogeneous(pose: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return matrix


@every_robot
def test_the_links_are_where_urdf_and_forward_kinematics_have_them(name: str) -> None:
    robot = load_robot(name)
    for joint_positions in robot.joint_limits.sample(5, np.random.default_rng(3)):
        expected = poses_by_urdf(robot, joint_positions)
        found = link_poses(robot, joint_positions)
        assert found.keys() == expected.keys() - {robot.base_frame}
        for link, pose in found.items():
            np.testing.assert_allclose(homogeneous(np.array(pose)), expected[link], atol=1e-9)
        end = robot.forward_kinematics.poses(joint_positions[None])[0]
        np.testing.assert_allclose(homogeneous(end), expected[robot.end_effector_frame], atol=1e-9)


@every_robot
def test_the_urdf_has_the_joints_and_limits_and_is_drawn(name: str) -> None:
    robot = load_robot(name)
    root = ElementTree.fromstring(robot_urdf(robot))
    assert root.attrib == {"name": robot.name}
    links = [link.attrib["name"] for link in root.iter("link")]
    assert len(set(links)) == len(links)
    joints = {joint.attrib["name"]: joint for joint in root.iter("joint")}
    assert len(joints) == len(links) - 1
    for number, joint in enumerate(robot.joint_names):
        limit = joints[joint].find("limit")
        assert limit is not None
        if joints[joint].attrib["type"] != "continuous":
            assert float(limit.attrib["lower"]) == robot.joint_limits.lower[number]
            assert float(limit.attrib["upper"]) == robot.joint_limits.upper[number]
    visuals = [
        link.attrib["name"] for link in root.iter("link") if link.find("visual") is not None
    ]
    assert robot.end_effector_frame in visuals


def test_an_arm_can_be_read_again_from_its_urdf() -> None:
    robot = load_robot("ur5e")
    again = load_robot(robot_urdf(robot))
    assert again.joint_names == robot.joint_names
    assert (again.base_frame, again.end_effector_frame) == ("base_link", "tool0")
    positions = robot.joint_limits.sample(10, np.random.default_rng(4))
    np.testing.assert_array_equal(
        again.forward_kinematics.poses(positions), robot.forward_kinematics.poses(positions)
    )


def test_the_axes_of_the_gantry_mimic_its_drives() -> None:
    robot = load_robot("gantry")
    root = ElementTree.fromstring(robot_urdf(robot))
    mimics = [mimic for joint in root.iter("joint") if (mimic := joint.find("mimic")) is not None]
    assert sorted(mimic.attrib["joint"] for mimic in mimics) == sorted(robot.joint_names)
