"""A robot as a URDF to look at, and where its links are: for RViz and robot_state_publisher."""

from collections.abc import Sequence
from functools import lru_cache
from math import atan2, hypot
from xml.etree import ElementTree

import numpy as np

from annik_core.pose import FloatArray, quaternion_from_roll_pitch_yaw
from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain, joint_axis, joint_origin
from annik_core.robots.urdf import add_joint, as_numbers, as_text
from annik_core.robots.urdf_text import parsed

#: The axes of a gantry from its base on: the orientation is yaw, then pitch, then roll.
_AXES_FROM_BASE = (0, 1, 2, 5, 4, 3)


def robot_urdf(robot: Robot) -> str:
    """The URDF of a robot as described, without the corrections of a calibration.

    An arm is its chain, drawn as sticks. The axes of a gantry mimic its drives, so that the joint
    names are those of its commands.
    """
    kinematics = robot.forward_kinematics
    if isinstance(kinematics, GantryKinematics):
        root = _gantry(robot, kinematics)
    else:
        root = parsed(robot.definition["urdf"], robot.name)
    root.set("name", robot.name)
    _draw(root)
    return as_text(root)


def link_poses(robot: Robot, joint_positions: FloatArray) -> dict[str, list[float]]:
    """Poses ``(7,)`` of the links of :func:`robot_urdf` in the base frame, but of the base.

    ``robot`` has no corrections of a calibration, and is at joint positions ``(dof,)``.
    """
    from scipy.spatial.transform import Rotation

    kinematics = robot.forward_kinematics
    if not isinstance(kinematics, GantryKinematics):
        links, chain = _links(robot.definition["urdf"])
        positions = np.zeros(len(links))
        positions[chain.axes.any(axis=1)] = joint_positions
        frames = chain.frames(positions)[:-1]
        quaternions = Rotation.from_matrix(frames[:, :3, :3]).as_quat(canonical=True)
        arm_poses = np.concatenate([frames[:, :3, 3], quaternions], axis=1).tolist()
        return dict(zip(links, arm_poses, strict=True))
    poses = {
        f"{drive}_shaft": [0.0, 0.0, 0.0, *quaternion_from_roll_pitch_yaw(0.0, 0.0, angle)]
        for drive, angle in zip(robot.joint_names, joint_positions.tolist(), strict=True)
    }
    task = kinematics.task_coordinates(joint_positions[np.newaxis])[0].tolist()
    moved = [0.0] * 6
    for axis, link in zip(_AXES_FROM_BASE, _slides(robot), strict=True):
        moved[axis] = task[axis]
        poses[link] = [*moved[:3], *quaternion_from_roll_pitch_yaw(*moved[3:])]
    return poses


@lru_cache(maxsize=4)
def _links(urdf: str) -> tuple[list[str], ScrewChain]:
    """The links of an arm but the base, and the chain of all joints above them, fixed ones too."""
    joints = list(ElementTree.fromstring(urdf).iter("joint"))
    placements = np.array([*map(joint_origin, joints), np.eye(4)])
    links = [child.attrib["link"] for joint in joints for child in joint.iter("child")]
    return links, ScrewChain(placements, np.array([joint_axis(joint) for joint in joints]))


def _slides(robot: Robot) -> list[str]:
    """The links that the axes of a gantry move, from the base on."""
    between = [f"{robot.joint_names[axis]}_slide" for axis in _AXES_FROM_BASE[:-1]]
    return [*between, robot.end_effector_frame]


def _gantry(robot: Robot, kinematics: GantryKinematics) -> ElementTree.Element:
    root = ElementTree.Element("robot")
    ElementTree.SubElement(root, "link", name=robot.base_frame)
    limits = np.array([robot.joint_limits.lower, robot.joint_limits.upper])
    reached = np.sort(kinematics.task_coordinates(limits), axis=0).T.tolist()
    directions = np.eye(3).tolist()
    for drive, bounds in zip(robot.joint_names, limits.T.tolist(), strict=True):
        ends = robot.base_frame, f"{drive}_shaft"
        add_joint(root, drive, "revolute", *ends, axis=directions[2], limits=bounds)
    parent = robot.base_frame
    for axis, link in zip(_AXES_FROM_BASE, _slides(robot), strict=True):
        drive = robot.joint_names[axis]
        kind = "prismatic" if axis < 3 else "revolute"
        motion = {"axis": directions[axis % 3], "limits": reached[axis]}
        joint = add_joint(root, f"{drive}_axis", kind, parent, link, **motion)
        ratio, offset = repr(kinematics.ratio[axis].item()), repr(kinematics.offset[axis].item())
        ElementTree.SubElement(joint, "mimic", joint=drive, multiplier=ratio, offset=offset)
        parent = link
    return root


def _draw(root: ElementTree.Element) -> None:
    """Draw a stick from each joint of a link to the next, a ball at joints, a box at the end."""
    links = {link.attrib["name"]: link for link in root.iter("link")}

    def add(
        link: str, shape: str, xyz: Sequence[float], rpy: Sequence[float], **size: str
    ) -> None:
        visual = ElementTree.SubElement(links[link], "visual")
        ElementTree.SubElement(visual, "origin", xyz=as_numbers(xyz), rpy=as_numbers(rpy))
        ElementTree.SubElement(ElementTree.SubElement(visual, "geometry"), shape, size)

    zero = (0.0, 0.0, 0.0)
    joints = [{part.tag: part.attrib for part in joint} for joint in root.iter("joint")]
    origins = [[float(part) for part in joint["origin"]["xyz"].split()] for joint in joints]
    # A share of the length of the chain, which is zero for a gantry [m].
    radius = sum(hypot(*origin) for origin in origins) / 40 or 0.02
    for joint, (x, y, z) in zip(joints, origins, strict=True):
        if hypot(x, y, z) > radius:
            turned = (0.0, atan2(hypot(x, y), z), atan2(y, x))
            stick = {"radius": repr(radius), "length": repr(hypot(x, y, z))}
            add(joint["parent"]["link"], "cylinder", (x / 2, y / 2, z / 2), turned, **stick)
        if "axis" in joint:
            add(joint["child"]["link"], "sphere", zero, zero, radius=repr(1.5 * radius))
    box = as_numbers((2.0 * radius, 3.0 * radius, 4.0 * radius))
    add(joints[-1]["child"]["link"], "box", zero, zero, size=box)
