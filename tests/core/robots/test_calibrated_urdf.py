"""A calibrated arm as a URDF: its forward kinematics, read back by annik and by pinocchio."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.arm_corrections import corrected, drawn_corrections
from support.urdf_texts import joint, planar_arm, urdf

from annik_core.installation import share_directory
from annik_core.pose import pose_distance
from annik_core.robots.calibrated_urdf import (
    calibrated_urdf,
    geometric_robot,
    left_out,
    with_ur_calibration,
)
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot

DATA = Path(__file__).parents[4] / "shared" / "data"
ROBOTS = share_directory() / "robots"
VISUAL = '<visual><geometry><sphere radius="0.1"/></geometry></visual>'
#: With meshes and other links off the chain, and no fixed joint at its end.
WITH_MORE = urdf(
    ("base", "upper", "fore", "hand", "camera", "hand_as_described"),
    joint("shoulder", "base", "upper", limit='lower="-3" upper="3"'),
    joint("elbow", "upper", "fore", origin='xyz="1 0 0"', limit='lower="-3" upper="3"'),
    joint("wrist", "fore", "hand", "prismatic", axis='xyz="0 1 0"', limit='lower="0" upper="1"'),
    joint("mount", "fore", "camera", "fixed"),
    joint("other", "base", "hand_as_described", "fixed"),
).replace('<link name="camera"/>', f'<link name="camera">{VISUAL}</link>')


def calibrated(source: str, **options: str) -> Robot:
    robot = load_robot(source, **options)
    return corrected(robot, drawn_corrections(robot, 1))


def differences(text: str, robot: Robot) -> tuple[float, float]:
    """Of the URDF, read by annik, from the geometric part: largest distance and angle."""
    frames = {"base_frame": robot.base_frame, "end_effector_frame": robot.end_effector_frame}
    again = load_robot(text, **frames)
    assert again.joint_names == robot.joint_names
    joint_positions = robot.joint_box.sample(100, np.random.default_rng(0))
    poses = again.forward_kinematics.poses(joint_positions)
    expected = geometric_robot(robot).forward_kinematics.poses(joint_positions)
    distances, angles = pose_distance(poses, expected)
    return float(distances.max()), float(angles.max())


@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14", "puma560", "scara", "xarm6"])
@pytest.mark.parametrize("whole", [False, True])
def test_the_geometric_part_of_packaged_arms(name: str, whole: bool) -> None:
    robot = calibrated(name)
    description = (ROBOTS / f"{name}.urdf").read_text("utf-8") if whole else None
    distance, angle = differences(calibrated_urdf(robot, description), robot)
    assert distance < 1e-12
    assert angle < 1e-7  # roll, pitch, yaw near a pitch of 90 degrees


def test_what_is_off_the_chain_is_kept() -> None:
    robot = calibrated(WITH_MORE, end_effector_frame="hand")
    text = calibrated_urdf(robot, WITH_MORE)
    assert differences(text, robot)[0] < 1e-12
    assert "<visual" in text and 'name="mount"' in text
    # The camera is on the link as it is.
    assert load_robot(text, end_effector_frame="camera").joint_names == ("shoulder", "elbow")


def test_a_chain_up_the_tree_is_written_alone() -> None:
    robot = calibrated(planar_arm(), base_frame="hand", end_effector_frame="base")
    assert differences(calibrated_urdf(robot, planar_arm()), robot)[0] < 1e-12


def test_pinocchio_reads_the_same() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    robot = calibrated(WITH_MORE, end_effector_frame="hand")
    # It demands what the format does, and annik does not.
    text = calibrated_urdf(robot, WITH_MORE)
    text = text.replace("<limit ", '<limit effort="1" velocity="1" ')
    model = pinocchio.buildModelFromXML(text)
    data, frame = model.createData(), model.getFrameId("hand")
    joint_positions = robot.joint_box.sample(20, np.random.default_rng(0))
    expected = geometric_robot(robot).forward_kinematics.poses(joint_positions)
    for row, pose in zip(joint_positions, expected, strict=True):
        pinocchio.framesForwardKinematics(model, data, row)
        found = pinocchio.SE3ToXYZQUAT(data.oMf[frame])
        assert np.allclose(found[:3], pose[:3], atol=1e-12)
        assert abs(abs(found[3:] @ pose[3:]) - 1.0) < 1e-12


def test_a_comment_says_how_much_is_left_out() -> None:
    robot = load_robot("ur5e")
    both = drawn_corrections(robot, 1)
    amounts = left_out(corrected(robot, both))
    assert 0.0 < amounts.mean < amounts.largest < 0.05
    assert f"{1e3 * amounts.largest:.3g} mm" in calibrated_urdf(corrected(robot, both))
    unfitted = corrected(robot, ArmCorrections(both.placements))
    joint_positions = robot.joint_box.sample(200, np.random.default_rng(3))
    apart, _ = pose_distance(
        unfitted.forward_kinematics.poses(joint_positions),
        corrected(robot, both).forward_kinematics.poses(joint_positions),
    )
    assert amounts.mean < 0.7 * apart.mean()
    geometry = ArmCorrections(both.placements)
    assert left_out(corrected(robot, geometry)).largest < 1e-12


def test_around_given_joint_positions_it_is_nearer_there() -> None:
    robot = load_robot("ur5e")
    bent = corrected(robot, drawn_corrections(robot, 1))
    around = np.random.default_rng(0).normal([0.5, -1.2, 1.0, 0.3, 1.5, 0.2], 0.3, (40, 6))
    wanted = bent.forward_kinematics.poses(around)
    apart = [
        pose_distance(geometric_robot(bent, there).forward_kinematics.poses(around), wanted)[0]
        for there in (None, around)
    ]
    assert apart[1].mean() < 0.5 * apart[0].mean()
    assert left_out(bent, around).mean < left_out(bent).mean
    assert "where the arm was measured" in calibrated_urdf(bent, None, around)


KINEMATICS = """
kinematics:
  shoulder: {x: 0, y: 0, z: 0.1627, roll: -0, pitch: 0, yaw: 1.5e-05}
  upper_arm: {x: 1.8e-4, y: 0, z: 0, roll: 1.5713, pitch: 0, yaw: 1.1e-06}
  forearm: {x: -0.42517, y: 0, z: 0, roll: 0.0014, pitch: -0.0004, yaw: 4.6e-06}
  wrist_1: {x: -0.3926, y: -0.0004, z: 0.1331, roll: 0.003, pitch: -0.0012, yaw: -2.6e-06}
  wrist_2: {x: -7.1e-06, y: -0.0996, z: -3.2e-07, roll: 1.5708, pitch: 0, yaw: 1.3e-06}
  wrist_3: {x: 1.4e-05, y: 0.0996, z: 9.5e-05, roll: 1.5717, pitch: 3.14159265, yaw: 3.1415925}
  hash: calib_1
"""


def test_a_factory_calibration_of_universal_robots(tmp_path: Path) -> None:
    """Millimetres from the usual one; each joint is where the file says."""
    (tmp_path / "calibration.yaml").write_text(KINEMATICS, encoding="utf-8")
    usual = load_robot("ur5e")
    own = with_ur_calibration(usual, tmp_path / "calibration.yaml")
    joint_positions = usual.joint_box.sample(100, np.random.default_rng(0))
    distances, angles = pose_distance(
        *(one.forward_kinematics.poses(joint_positions) for one in (usual, own))
    )
    assert 1e-4 < distances.max() < 5e-3
    assert angles.max() < 0.02


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "kinematics"),
        ("kinematics: 3", "shoulder"),
        (KINEMATICS.replace("z: 0.1627, ", ""), "shoulder"),
        (KINEMATICS.replace("0.1627", "up"), "shoulder"),
        (KINEMATICS.replace("0.1627", ".nan"), "shoulder"),
        (KINEMATICS.replace("wrist_3", "wrist_4"), "wrist_3"),
        (KINEMATICS.replace("-0.42517", "-0.612"), "elbow_joint"),
        ("a: [", "not readable"),
    ],
)
def test_a_damaged_factory_calibration_is_refused(tmp_path: Path, text: str, named: str) -> None:
    (tmp_path / "calibration.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InvalidRobotDefinition) as caught:
        with_ur_calibration(load_robot("ur5e"), tmp_path / "calibration.yaml")
    assert named in str(caught.value)


def test_a_factory_calibration_is_of_universal_robots_alone(tmp_path: Path) -> None:
    (tmp_path / "calibration.yaml").write_text(KINEMATICS, encoding="utf-8")
    with pytest.raises(InvalidRobotDefinition) as caught:
        with_ur_calibration(load_robot(planar_arm()), tmp_path / "calibration.yaml")
    assert "shoulder_pan_joint" in str(caught.value)
    for robot in (load_robot("gantry"), calibrated("ur5e")):
        with pytest.raises(InvalidRobotDefinition):
            with_ur_calibration(robot, tmp_path / "calibration.yaml")
    with pytest.raises(InvalidRobotDefinition):
        with_ur_calibration(load_robot("ur5e"), tmp_path / "none.yaml")


@pytest.mark.skipif(not DATA.is_dir(), reason="../shared/data is not beside this checkout")
def test_a_factory_calibration_of_a_real_ur5e() -> None:
    usual = load_robot("ur5e")
    own = with_ur_calibration(usual, DATA / "ur_calibration" / "ur5e_a.yaml")
    joint_positions = usual.joint_box.sample(100, np.random.default_rng(0))
    distances, _ = pose_distance(
        *(one.forward_kinematics.poses(joint_positions) for one in (usual, own))
    )
    assert 1e-4 < distances.max() < 5e-3
