"""A calibrated arm as a URDF, and a URDF with the calibration of its maker.

A URDF has origins and axes of joints. So it can carry the geometric part of a calibration; what
depends on the joint positions, such as deflection and the errors of transmissions, it can't.
"""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.files import bounded_yaml, read_text
from annik_core.pose import FloatArray, pose_distance, roll_pitch_yaw
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.definition import checked_numbers
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain, joint_origin, motion_matrices
from annik_core.robots.urdf import add_joint, as_numbers, as_text
from annik_core.robots.urdf_text import parsed

#: Joint of each link of Universal Robots' kinematics file.
_UR_JOINTS = {
    "shoulder": "shoulder_pan_joint",
    "upper_arm": "shoulder_lift_joint",
    "forearm": "elbow_joint",
    "wrist_1": "wrist_1_joint",
    "wrist_2": "wrist_2_joint",
    "wrist_3": "wrist_3_joint",
}
_UR_NUMBERS = ("x", "y", "z", "roll", "pitch", "yaw")
#: How far a calibrated joint may be from its description [m], [rad]. Offsets along axes that are
#: nearly parallel may be centimetres.
_NEAR, _NEAR_ANGLE = 0.1, np.radians(10.0)
_POSES = 300
#: Around given joint positions, in their standard deviations.
_AROUND = 0.1
#: Parts of corrections that change poses and are not geometric.
_OTHER_PARTS = frozenset(f.name for f in fields(ArmCorrections)) - {
    "placements",
    "error_bound",
    "provenance",
}
#: Steps to the nearest geometry; natural units of its motions [m], [rad].
_STEPS, _LENGTH, _ANGLE = 4, 1e-3, 5e-3


class LeftOut(NamedTuple):
    """What the geometric part of a calibrated robot leaves out."""

    mean: float  #: distance [m]
    largest: float  #: [m]
    largest_angle: float  #: [rad]


def geometric_robot(robot: Robot, around: FloatArray | None = None) -> Robot:
    """A calibrated arm with corrections of its geometry alone.

    Those of the calibration; or, if that has other parts too, the geometry that is nearest to all
    of them, by least squares around joint positions ``(n, dof)``, or over the joint box.
    """
    corrections = robot.definition["corrections"]
    geometric = _with_placements(robot, corrections["placements"])
    if set(corrections) & _OTHER_PARTS:
        joint_positions = _sampled(robot, around, 1)
        wanted = robot.forward_kinematics.poses(joint_positions)
        for _ in range(_STEPS):
            geometric = _nearer(geometric, joint_positions, wanted)
    return geometric


def _sampled(robot: Robot, around: FloatArray | None, seed: int) -> FloatArray:
    """Joint positions at random, ``(n, dof)``."""
    rng = np.random.default_rng(seed)
    if around is None:
        return robot.joint_box.sample(_POSES, rng)
    spread = _AROUND * np.std(around, axis=0)
    near: FloatArray = rng.normal(around[rng.integers(len(around), size=_POSES)], spread)
    return near


def _with_placements(robot: Robot, placements: Any) -> Robot:
    definition = {**robot.definition, "corrections": {"placements": placements}}
    return robot_from_definition(definition, robot.name)


def _nearer(geometric: Robot, joint_positions: FloatArray, wanted: FloatArray) -> Robot:
    """One Gauss-Newton step towards poses ``(n, 7)``, over the motions at all places."""
    placements = np.array(geometric.definition["corrections"]["placements"])
    chain = ScrewChain.from_urdf(geometric.definition["urdf"]).moved(placements)
    frames = chain.frames(joint_positions)
    end = frames[-1, :, :3, 3]
    places = [np.tile(np.eye(4), (len(end), 1, 1)), *frames[:-1]]
    columns = np.zeros((len(end), 6, len(places), 6))
    for place, frame in enumerate(places):
        axes, lever = frame[:, :3, :3], (end - frame[:, :3, 3])[:, :, np.newaxis]
        columns[:, :3, place, :3] = axes * _LENGTH
        columns[:, :3, place, 3:] = np.cross(axes, lever, axis=1) * _ANGLE
        columns[:, 3:, place, 3:] = axes * _ANGLE
    turned = Rotation.from_matrix(frames[-1, :, :3, :3])
    turn = (Rotation.from_quat(wanted[:, 3:]) * turned.inv()).as_rotvec()
    rows = np.concatenate([(wanted[:, :3] - end) / _LENGTH, turn / _ANGLE], axis=1)
    columns[:, :3] /= _LENGTH
    columns[:, 3:] /= _ANGLE
    matrix = columns.reshape(-1, 6 * len(places))
    # Slightly damped: some motions, such as those along parallel axes, change no pose.
    normal = matrix.T @ matrix + 1e-6 * len(matrix) * np.eye(matrix.shape[1])
    step = np.linalg.solve(normal, matrix.T @ rows.ravel()).reshape(-1, 6)
    turns = Rotation.from_rotvec(step[:, 3:] * _ANGLE)
    shifts = step[:, :3] * _LENGTH + turns.apply(placements[:, :3])
    quaternions = (turns * Rotation.from_quat(placements[:, 3:])).as_quat(canonical=True)
    return _with_placements(geometric, np.concatenate([shifts, quaternions], axis=1).tolist())


def left_out(robot: Robot, around: FloatArray | None = None) -> LeftOut:
    """How far the geometric part of a calibrated arm is from all of it, by random poses.

    In the joint box, or around joint positions ``(n, dof)``.
    """
    joint_positions = _sampled(robot, around, 0)
    distances, angles = pose_distance(
        robot.forward_kinematics.poses(joint_positions),
        geometric_robot(robot, around).forward_kinematics.poses(joint_positions),
    )
    return LeftOut(float(distances.mean()), float(distances.max()), float(angles.max()))


def calibrated_urdf(
    robot: Robot, description: str | None = None, around: FloatArray | None = None
) -> str:
    """The URDF of a calibrated arm: origins of joints changed by the geometric corrections.

    Args:
        robot: with corrections.
        description: the URDF that the robot was read from, whose other links, meshes and inertias
            are kept. Without it, or if its chain does not run from parents to children only, the
            URDF has the chain alone.
        around: ``(n, dof)`` joint positions around which the URDF is nearest to the robot, such as
            those that were measured; None for the whole joint box.
    """
    chain = parsed(robot.definition["urdf"], robot.name)
    placements = geometric_robot(robot, around).definition["corrections"]["placements"]
    motions = motion_matrices(np.array(placements))
    root, joints = chain, list(chain.iter("joint"))
    origins = dict(zip(map(_name, joints), map(joint_origin, joints), strict=True))
    if description is not None:
        whole = parsed(description, robot.name)
        known = {_name(joint): joint for joint in whole.iterfind("joint")}
        same = [known.get(_name(joint)) for joint in joints]
        if all(
            other is not None and _links(other) == _links(joint)
            for joint, other in zip(joints, same, strict=True)
        ):
            root, joints = whole, [joint for joint in same if joint is not None]
    # The motion after a joint is part of the origin of the next one.
    motion, place = motions[0], 0
    for joint in joints:
        _set_origin(joint, motion @ origins[_name(joint)])
        motion = np.eye(4)
        if joint.get("type") != "fixed":
            place += 1
            motion = motions[place]
    if joints[-1].get("type") != "fixed":
        _append(root, joints[-1], motion)
    text = as_text(root)
    return f"<?xml version='1.0'?>\n<!-- {_comment(robot, around)} -->\n{text}\n"


def with_ur_calibration(robot: Robot, path: Path) -> Robot:
    """An arm of Universal Robots as described, with the factory calibration of one of them.

    ``path`` is a kinematics file as ur_calibration writes it: ``kinematics``, with x, y, z [m],
    roll, pitch and yaw [rad] of every link.

    Raises:
        InvalidRobotDefinition: naming what is missing in the file or in the description.
    """
    source = str(path)
    try:
        data = bounded_yaml(read_text(path))
    except (OSError, ValueError) as error:
        raise InvalidRobotDefinition(source, f"not readable: {error}") from error
    links = data.get("kinematics") if isinstance(data, Mapping) else None
    if robot.kind != "arm" or "corrections" in robot.definition:
        raise InvalidRobotDefinition(source, f"{robot.name} is no arm as described")
    root = parsed(robot.definition["urdf"], source)
    joints = {_name(joint): joint for joint in root.iterfind("joint")}
    for link, joint in _UR_JOINTS.items():
        numbers = _ur_numbers(links, link, source)
        found = [one for name, one in joints.items() if name.endswith(joint)]
        if len(found) != 1:
            raise InvalidRobotDefinition(
                source, f"{robot.name} has no joint {joint}: it is no arm of Universal Robots"
            )
        _set_origin(found[0], _nearest(numbers, joint_origin(found[0]), joint, source))
    return robot_from_definition({**robot.definition, "urdf": as_text(root)}, robot.name)


def _nearest(numbers: FloatArray, described: FloatArray, joint: str, source: str) -> FloatArray:
    """The calibrated origin of a joint, near the described one.

    Their frame of the base is half a turn from base_link; some descriptions have that turn in a
    joint of its own, others in the origin of the first joint.
    """
    origin = np.eye(4)
    origin[:3, :3] = Rotation.from_euler("xyz", numbers[3:]).as_matrix()
    origin[:3, 3] = numbers[:3]
    for turn in (np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])):
        turned = turn @ origin
        angle = Rotation.from_matrix(turned[:3, :3] @ described[:3, :3].T).magnitude()
        distance = float(np.linalg.norm(turned[:3, 3] - described[:3, 3]))
        if distance < _NEAR and angle < _NEAR_ANGLE:
            return turned
    raise InvalidRobotDefinition(
        source,
        f"{joint} is elsewhere in the description: the calibration is of another model of arm, or "
        "the description has other frames than ur_description",
    )


def _ur_numbers(links: Any, link: str, source: str) -> FloatArray:
    entry = links.get(link) if isinstance(links, Mapping) else None
    if not isinstance(entry, Mapping) or not set(_UR_NUMBERS) <= set(entry):
        raise InvalidRobotDefinition(
            source, f"kinematics.{link} lacks one of {', '.join(_UR_NUMBERS)}"
        )
    values = [entry[name] for name in _UR_NUMBERS]
    numbers = checked_numbers(values, f"kinematics.{link}", source)
    if not np.isfinite(numbers).all():
        raise InvalidRobotDefinition(source, f"kinematics.{link} is not finite")
    return numbers


def _comment(robot: Robot, around: FloatArray | None) -> str:
    amounts = left_out(robot, around)
    where = "over the joint box" if around is None else "where the arm was measured"
    return (
        "Calibrated by annik: the geometric part. Errors that depend on the joint positions, such "
        f"as deflection, are not in a URDF; {where} they are "
        f"{1e3 * amounts.mean:.3g} mm on average and {1e3 * amounts.largest:.3g} mm at most."
    )


def _append(root: ElementTree.Element, last: ElementTree.Element, motion: FloatArray) -> None:
    """Put a motion between the last joint and its link, by a link and a fixed joint."""
    child = last.find("child")
    assert child is not None
    end = child.attrib["link"]
    taken = {element.get("name") for element in root}
    between = f"{end}_as_described"
    while between in taken:
        between += "_"
    child.set("link", between)
    joint = add_joint(root, f"{between}_joint", "fixed", between, end)
    _set_origin(joint, motion)
    # It adds its child link, which was there; the link that is missing is the one between.
    added = root[-1]
    added.set("name", between)


def _set_origin(joint: ElementTree.Element, matrix: FloatArray) -> None:
    quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(canonical=True)
    for old in joint.findall("origin"):
        joint.remove(old)
    numbers = matrix[:3, 3].tolist(), roll_pitch_yaw(quaternion.tolist())
    xyz, rpy = map(as_numbers, numbers)
    ElementTree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)


def _name(joint: ElementTree.Element) -> str:
    return joint.get("name", "")


def _links(joint: ElementTree.Element) -> tuple[str, ...]:
    ends = [joint.find(tag) for tag in ("parent", "child")]
    return tuple("" if end is None else end.get("link", "") for end in ends)
