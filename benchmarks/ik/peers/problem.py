"""The problem of the solvers: a robot, its frames and its joint box."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.robots.errors import InvalidRobotDefinition
from benchmarks.ik.peers.pose_matrix import roll_pitch_yaw
from benchmarks.ik.peers.serial_chain import SerialChain, joint_motion, joints_between, origin_of


@dataclass(frozen=True, eq=False)
class IkProblem:
    """The same for each solver.

    Attributes:
        urdf: text of the robot's description; only its kinematics are read.
        base_frame: link that the poses refer to.
        end_effector_frame: link whose pose is the target.
        joint_names: the moving joints from base to end effector, in this order.
        lower: ``(dof,)`` the robot's limits [rad or m].
        upper: ``(dof,)`` the robot's limits [rad or m].
        box_lower: ``(dof,)`` the joint box [rad or m].
        box_upper: ``(dof,)`` the joint box [rad or m]; a joint with equal bounds is locked.
    """

    urdf: str
    base_frame: str
    end_effector_frame: str
    joint_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray
    box_lower: FloatArray
    box_upper: FloatArray

    @cached_property
    def start(self) -> FloatArray:
        """``(dof,)``, the centre of the joint box, where every solver starts."""
        return 0.5 * (self.box_lower + self.box_upper)

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """``(free,)`` columns of the joints that are not locked."""
        return np.flatnonzero(self.box_lower < self.box_upper)

    @cached_property
    def free_start(self) -> FloatArray:
        """``(free,)``, the start of the joints that are not locked."""
        return self.start[self.free]

    @cached_property
    def free_box(self) -> tuple[FloatArray, FloatArray]:
        """Joint box of the joints that are not locked, two arrays ``(free,)``."""
        return self.box_lower[self.free], self.box_upper[self.free]

    @cached_property
    def free_bounds(self) -> list[tuple[float, float]]:
        """Bounds of the box of the joints that are not locked."""
        lower, upper = self.free_box
        return list(zip(lower.tolist(), upper.tolist(), strict=True))

    def free_of(self, start: FloatArray | None) -> FloatArray:
        """``(free,)`` of positions ``(dof,)``; of the start, if there are none."""
        return self.free_start if start is None else start[self.free]

    def with_locked(self, free_positions: FloatArray) -> FloatArray:
        """Positions ``(dof,)`` of all joints from those ``(free,)`` of the free ones."""
        if len(free_positions) == len(self.start):
            return free_positions
        positions = self.start.copy()
        positions[self.free] = free_positions
        return positions


def locked_urdf(problem: IkProblem) -> str:
    """The chain from base to end effector, its locked joints fixed at their values.

    Links have no geometry and no mass, and the limits of the other joints are the joint box: a
    solver that keeps to limits is so kept on the branch that the targets come from.

    Raises:
        InvalidRobotDefinition: if the description has no such chain with these joints.
    """
    joints = joints_between(problem.urdf, problem.base_frame, problem.end_effector_frame)
    moving = tuple(joint.get("name", "") for joint in joints if joint.get("type") != "fixed")
    if moving != problem.joint_names:
        raise InvalidRobotDefinition(
            "URDF",
            f"the joints from {problem.base_frame} to {problem.end_effector_frame} are "
            f"{', '.join(moving)}, not {', '.join(problem.joint_names)}",
        )
    robot = ElementTree.Element("robot", name="chain")
    ElementTree.SubElement(robot, "link", name=problem.base_frame)
    parent = problem.base_frame
    columns = {name: column for column, name in enumerate(problem.joint_names)}
    for joint in joints:
        name = joint.get("name", "")
        child = joint.find("child")
        assert child is not None  # joints_between came here by it
        child_name = child.get("link", "")
        kind = joint.get("type", "")
        placement = origin_of(joint)
        lower = upper = 0.0
        if kind != "fixed":
            column = columns[name]
            lower = float(problem.box_lower[column])
            upper = float(problem.box_upper[column])
            if lower == upper:
                placement = placement @ joint_motion(joint, lower)
                kind = "fixed"
            elif kind == "continuous":
                kind = "revolute"
        written = ElementTree.SubElement(robot, "joint", name=name, type=kind)
        ElementTree.SubElement(written, "parent", link=parent)
        ElementTree.SubElement(written, "child", link=child_name)
        ElementTree.SubElement(
            written,
            "origin",
            xyz=_text(placement[:3, 3]),
            rpy=_text(np.array(roll_pitch_yaw(placement[:3, :3]))),
        )
        if kind != "fixed":
            axis = joint.find("axis")
            ElementTree.SubElement(
                written, "axis", xyz="1 0 0" if axis is None else axis.get("xyz", "1 0 0")
            )
            ElementTree.SubElement(
                written, "limit", lower=repr(lower), upper=repr(upper), effort="1", velocity="1"
            )
        ElementTree.SubElement(robot, "link", name=child_name)
        parent = child_name
    return ElementTree.tostring(robot, encoding="unicode")


def free_chain(problem: IkProblem) -> SerialChain:
    """The chain of the joints that are not locked.

    Raises:
        InvalidRobotDefinition: if the description has no such chain with these joints.
    """
    return SerialChain.from_urdf(
        locked_urdf(problem), problem.base_frame, problem.end_effector_frame
    )


def _text(numbers: FloatArray) -> str:
    """Numbers as a URDF has them, without loss."""
    return " ".join(repr(number) for number in numbers.tolist())
