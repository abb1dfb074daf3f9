"""Where the links and joints of a robot are, to be drawn."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain

#: Points of the arc, or the line, that shows the range of a joint; and its distance from the
#: joint, as a share of the reach.
_RANGE_POINTS, _RANGE_SIZE = 33, 0.09


class Posture(NamedTuple):
    """A robot at some joint positions, in its base frame.

    Attributes:
        points: ``(n, 3)`` from the base along the links to the end effector [m].
        axes: ``(n - 2, 3)`` unit vectors of the joints at the points between the ends.
    """

    points: FloatArray
    axes: FloatArray


@dataclass(frozen=True, eq=False)
class Skeleton:
    """The points of a robot between which its links are drawn."""

    robot: Robot

    def posture(self, joint_positions: FloatArray) -> Posture:
        """The robot at joint positions ``(dof,)`` [rad or m]; the last point is exact."""
        rows = joint_positions[np.newaxis]
        end = self.robot.forward_kinematics.poses(rows)[0, :3]
        if self._chain is None:
            x, y, z = end
            points = np.array([[0.0, 0.0, 0.0], [x, 0.0, 0.0], [x, y, 0.0], [x, y, z]])
            return Posture(points, np.eye(3)[:2])
        frames = self._chain.frames(self._actual(rows)[0])
        points = np.vstack([np.zeros(3), frames[:-1, :3, 3], end])
        linear, angular = self._chain.axes[:, :3], self._chain.axes[:, 3:]
        return Posture(points, np.einsum("nij,nj->ni", frames[:-1, :3, :3], linear + angular))

    def ranges(self, joint_positions: FloatArray) -> FloatArray:
        """Segments ``(n, 2, 3)`` [m] that show how far each joint may go, and where it is.

        Of each joint of an arm, but those that can make a whole turn: an arc or a line from limit
        to limit, and a hand from the joint to its place there.
        """
        if self._chain is None:
            return np.empty((0, 2, 3))
        limits, dof = self.robot.joint_limits, self.robot.dof
        rows = np.tile(joint_positions, (dof, _RANGE_POINTS + 1, 1))
        for joint in range(dof):
            rows[joint, 1:, joint] = np.linspace(
                limits.lower[joint], limits.upper[joint], _RANGE_POINTS
            )
        frames = self._chain.frames(self._actual(rows.reshape(-1, dof)))
        found = [np.empty((0, 2, 3))]
        for joint, axis in enumerate(self._chain.axes[:, :3] + self._chain.axes[:, 3:]):
            if limits.upper[joint] - limits.lower[joint] < 2.0 * np.pi - 1e-6:
                placed = frames[joint, joint * len(rows[0]) : (joint + 1) * len(rows[0])]
                across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
                across *= _RANGE_SIZE * self.reach / np.linalg.norm(across)
                here, *line = placed[:, :3, :3] @ across + placed[:, :3, 3]
                hand = [placed[0, :3, 3], here]
                found += [np.stack([line[:-1], line[1:]], axis=1), np.array([hand])]
        return np.vstack(found)

    @cached_property
    def reach(self) -> float:
        """Length of the chain from base to end effector at zero positions [m]."""
        if self._chain is None:
            limits = np.array([self.robot.joint_limits.lower, self.robot.joint_limits.upper])
            return float(np.abs(self.robot.forward_kinematics.poses(limits)[:, :3]).max())
        points = self.posture(np.zeros(self.robot.dof)).points
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) or 1.0

    def _actual(self, rows: FloatArray) -> FloatArray:
        networks = None if self._corrections is None else self._corrections.joint_networks
        return rows if networks is None else networks.actual(self.robot.in_box(rows))

    @cached_property
    def _corrections(self) -> ArmCorrections | None:
        data = self.robot.definition.get("corrections")
        if data is None:
            return None
        return ArmCorrections.from_dict(data, self.robot.dof, self.robot.name)

    @cached_property
    def _chain(self) -> ScrewChain | None:
        if isinstance(self.robot.forward_kinematics, GantryKinematics):
            return None
        chain = ScrewChain.from_urdf(self.robot.definition["urdf"])
        return chain if self._corrections is None else chain.moved(self._corrections.placements)
