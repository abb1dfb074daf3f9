"""A serial chain as a product of screw motions."""

import math
from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree

import numpy as np

from annik_core.pose import FloatArray, quaternion_from_roll_pitch_yaw, rotation_matrix


@dataclass(frozen=True, eq=False)
class ScrewChain:
    """A chain as a product: (placement, joint motion) for each joint, then the last placement.

    Attributes:
        placements: ``(dof + 1, 4, 4)`` of each joint in the frame of the one before, at zero
            position, and of the end effector in the last joint's.
        axes: ``(dof, 6)`` unit twists of the joints in their own frames: linear, angular.
    """

    placements: FloatArray
    axes: FloatArray

    @classmethod
    def from_urdf(cls, urdf: str) -> "ScrewChain":
        """The chain of a URDF that :func:`annik_core.robots.urdf.serial_chain` has written."""
        placements, axes = [np.eye(4)], []
        for joint in ElementTree.fromstring(urdf).iterfind("joint"):
            placements[-1] = placements[-1] @ joint_origin(joint)
            if joint.get("type") != "fixed":
                axes.append(joint_axis(joint))
                placements.append(np.eye(4))
        return cls(np.array(placements), np.array(axes))

    def moved(self, motions: FloatArray) -> "ScrewChain":
        """The chain with small motions, poses ``(dof + 1, 7)``, of all that follows.

        The first is before the first joint, in the base frame; number i after the i-th joint, in
        its frame.
        """
        return ScrewChain(motion_matrices(motions) @ self.placements, self.axes)

    def frames(self, joint_positions: FloatArray) -> FloatArray:
        """Frames ``(dof + 1, ..., 4, 4)`` of joints and end effector, for ``(..., dof)``."""
        linear, cross, crossed_twice = self._motions
        angles = joint_positions[..., np.newaxis, np.newaxis]
        motions = np.zeros((*joint_positions.shape, 4, 4))
        # Rodrigues' formula; the angular axis of a prismatic joint is zero.
        motions[..., :3, :3] = (
            np.eye(3) + np.sin(angles) * cross + (1.0 - np.cos(angles)) * crossed_twice
        )
        motions[..., :3, 3] = joint_positions[..., np.newaxis] * linear
        motions[..., 3, 3] = 1.0
        steps = self.placements[:-1] @ motions
        frames = np.empty((len(self.axes) + 1, *steps.shape[:-3], 4, 4))
        frames[0] = steps[..., 0, :, :]
        for joint in range(1, len(self.axes)):
            frames[joint] = frames[joint - 1] @ steps[..., joint, :, :]
        frames[-1] = frames[-2] @ self.placements[-1]
        return frames

    @cached_property
    def _motions(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linear axes ``(dof, 3)``, cross products as matrices ``(dof, 3, 3)``, their squares."""
        cross = np.cross(self.axes[:, np.newaxis, 3:], np.eye(3)).transpose(0, 2, 1)
        return self.axes[:, :3], cross, cross @ cross


def motion_matrices(motions: FloatArray) -> FloatArray:
    """Motions given as poses ``(n, 7)``, as matrices ``(n, 4, 4)``."""
    matrices = np.tile(np.eye(4), (len(motions), 1, 1))
    matrices[:, :3, :3] = [rotation_matrix(motion[3:]) for motion in motions]
    matrices[:, :3, 3] = motions[:, :3]
    return matrices


def joint_origin(joint: ElementTree.Element) -> FloatArray:
    """The origin ``(4, 4)`` of a joint of a URDF in its parent link."""
    origin = np.eye(4)
    element = joint.find("origin")
    if element is not None:
        quaternion = quaternion_from_roll_pitch_yaw(*_numbers(element, "rpy").tolist())
        origin[:3, :3] = rotation_matrix(np.array(quaternion))
        origin[:3, 3] = _numbers(element, "xyz")
    return origin


def joint_axis(joint: ElementTree.Element) -> FloatArray:
    """The unit twist ``(6,)`` of a joint of a URDF in its own frame; zeros if it is fixed."""
    twist = np.zeros(6)
    element = joint.find("axis")
    if element is not None:
        axis = _numbers(element, "xyz")
        part = slice(0, 3) if joint.get("type") == "prismatic" else slice(3, 6)
        twist[part] = axis / math.hypot(*axis.tolist())
    return twist


def _numbers(element: ElementTree.Element, key: str) -> FloatArray:
    return np.array([float(text) for text in element.get(key, "0 0 0").split()])
