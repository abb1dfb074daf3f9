"""The joints between two links of a URDF, fixed ones merged into the placement of the next."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition

MOVING = {"revolute", "continuous", "prismatic"}


@dataclass(frozen=True, eq=False)
class ChainJoint:
    """A moving joint.

    Attributes:
        name: of the joint.
        prismatic: whether it slides; otherwise it turns.
        placement: ``(4, 4)``, of its frame in that of the joint before it [m].
        axis: ``(3,)`` unit vector in its frame.
    """

    name: str
    prismatic: bool
    placement: FloatArray
    axis: FloatArray

    def motion(self, position: float) -> FloatArray:
        """What the joint does ``(4, 4)`` at a position [rad or m]."""
        return _motion(self.axis, self.prismatic, position)

    def motions(self, positions: FloatArray) -> FloatArray:
        """What the joint does ``(n, 4, 4)`` at positions ``(n,)`` [rad or m]."""
        motions = np.tile(np.eye(4), (len(positions), 1, 1))
        if self.prismatic:
            motions[:, :3, 3] = positions[:, np.newaxis] * self.axis
            return motions
        cross = _cross(self.axis)
        sines = np.sin(positions)[:, np.newaxis, np.newaxis]
        rest = 1.0 - np.cos(positions)[:, np.newaxis, np.newaxis]
        motions[:, :3, :3] += sines * cross + rest * (cross @ cross)
        return motions

    @property
    def z_to_axis(self) -> FloatArray:
        """A rotation ``(4, 4)`` that turns z onto the axis, for solvers whose joints are along z.

        The identity where the axis is z already.
        """
        turn = np.eye(4)
        z, x, y = self.axis[2], self.axis[0], self.axis[1]
        if z < -0.5:
            # Half a turn about x first, to stay off the pole of the formula below.
            turn[:3, :3] = _z_to(np.array([x, -y, -z]))
            turn[1:3] *= -1.0
            return turn
        turn[:3, :3] = _z_to(self.axis)
        return turn


@dataclass(frozen=True, eq=False)
class SerialChain:
    """Moving joints one after another, then the end effector.

    Attributes:
        joints: the moving joints.
        tip: ``(4, 4)``, end effector in the frame of the last joint [m].
    """

    joints: tuple[ChainJoint, ...]
    tip: FloatArray

    @classmethod
    def from_urdf(cls, urdf: str, base_frame: str, end_effector_frame: str) -> SerialChain:
        """The chain between two links.

        Raises:
            InvalidRobotDefinition: if there is none, or it has joints with several axes.
        """
        placement = np.eye(4)
        joints: list[ChainJoint] = []
        for element in joints_between(urdf, base_frame, end_effector_frame):
            placement = placement @ origin_of(element)
            kind = element.get("type", "")
            if kind == "fixed":
                continue
            joints.append(
                ChainJoint(
                    element.get("name", ""), kind == "prismatic", placement, axis_of(element)
                )
            )
            placement = np.eye(4)
        return cls(tuple(joints), placement)

    @property
    def zero_placements(self) -> FloatArray:
        """Frames ``(n + 1, 4, 4)`` of the joints and the tip in the base, all joints at zero."""
        frames = [np.eye(4)]
        for joint in self.joints:
            frames.append(frames[-1] @ joint.placement)
        frames.append(frames[-1] @ self.tip)
        return np.stack(frames[1:])

    def tip_placement(self, joint_positions: FloatArray) -> FloatArray:
        """End effector ``(4, 4)`` in the base, from joint positions ``(n,)`` [rad or m]."""
        placement = np.eye(4)
        for joint, position in zip(self.joints, joint_positions.tolist(), strict=True):
            placement = placement @ joint.placement @ joint.motion(position)
        tip: FloatArray = placement @ self.tip
        return tip

    def tip_placements(self, joint_positions: FloatArray) -> FloatArray:
        """End effectors ``(m, 4, 4)`` in the base, from joint positions ``(m, n)`` [rad or m]."""
        placements = np.tile(np.eye(4), (len(joint_positions), 1, 1))
        for joint, positions in zip(self.joints, joint_positions.T, strict=True):
            placements = placements @ joint.placement @ joint.motions(positions)
        tips: FloatArray = placements @ self.tip
        return tips


def joints_between(urdf: str, base_frame: str, tip_frame: str) -> list[ElementTree.Element]:
    """The joint elements from one link to another, in this order.

    Raises:
        InvalidRobotDefinition: if the text is not XML, there is no such chain, or one of its
            joints moves along more than one axis.
    """
    try:
        robot = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise InvalidRobotDefinition("URDF", f"it is not XML ({error})") from error
    by_child: dict[str, tuple[ElementTree.Element, str]] = {}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            by_child[child.get("link", "")] = (joint, parent.get("link", ""))
    joints: list[ElementTree.Element] = []
    link = tip_frame
    while link != base_frame:
        # Taken out, so that links in a circle end the walk.
        joint_and_parent = by_child.pop(link, None)
        if joint_and_parent is None:
            raise InvalidRobotDefinition("URDF", f"no chain from {base_frame} to {tip_frame}")
        joint, link = joint_and_parent
        kind = joint.get("type")
        if kind != "fixed" and kind not in MOVING:
            raise InvalidRobotDefinition(
                "URDF", f"joint {joint.get('name')} is {kind}: it has not one axis"
            )
        joints.append(joint)
    return joints[::-1]


def origin_of(joint: ElementTree.Element) -> FloatArray:
    """Placement ``(4, 4)`` of a joint element in its parent link [m]."""
    placement = np.eye(4)
    origin = joint.find("origin")
    if origin is None:
        return placement
    roll, pitch, yaw = _numbers(origin.get("rpy", "0 0 0"))
    x, y, z = np.eye(3)
    placement[:3, :3] = _turn(z, yaw) @ _turn(y, pitch) @ _turn(x, roll)
    placement[:3, 3] = _numbers(origin.get("xyz", "0 0 0"))
    return placement


def axis_of(joint: ElementTree.Element) -> FloatArray:
    """Unit vector ``(3,)`` of a joint element's axis; x where none is given, as URDF has it."""
    axis = joint.find("axis")
    vector = np.array(_numbers("1 0 0" if axis is None else axis.get("xyz", "1 0 0")))
    norm = float(np.linalg.norm(vector))
    if norm == 0.0:
        raise InvalidRobotDefinition("URDF", f"joint {joint.get('name')} has no axis")
    unit: FloatArray = vector / norm
    return unit


def joint_motion(joint: ElementTree.Element, position: float) -> FloatArray:
    """What a joint element does ``(4, 4)`` at a position [rad or m]."""
    return _motion(axis_of(joint), joint.get("type") == "prismatic", position)


def _motion(axis: FloatArray, prismatic: bool, position: float) -> FloatArray:
    motion = np.eye(4)
    if prismatic:
        motion[:3, 3] = position * axis
    else:
        motion[:3, :3] = _turn(axis, position)
    return motion


def _turn(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation ``(3, 3)`` about a unit vector."""
    cross = _cross(axis)
    turn: FloatArray = (
        np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    )
    return turn


def _cross(axis: FloatArray) -> FloatArray:
    """The matrix ``(3, 3)`` of the vector product with a vector."""
    x, y, z = axis.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _z_to(axis: FloatArray) -> FloatArray:
    """The shortest turn ``(3, 3)`` of z onto a unit vector that does not point along -z."""
    x, y, z = axis.tolist()
    share = 1.0 / (1.0 + z)
    return np.array(
        [
            [1.0 - share * x * x, -share * x * y, x],
            [-share * x * y, 1.0 - share * y * y, y],
            [-x, -y, z],
        ]
    )


def _numbers(text: str) -> list[float]:
    return [float(number) for number in text.split()]
