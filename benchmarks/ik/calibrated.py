"""A robot that is not as described: a calibration, made up, and what a URDF can say of it.

Every link and joint axis is off by about half a millimetre and half a milliradian, the joints turn
by about a milliradian more or less than commanded, more under the arm's weight, and the links bend
by about half a millimetre: the parts of :class:`annik_core.robots.corrections.ArmCorrections` that
``annik calibrate`` fits to measured arms, of the same size. annik begins at the solution of the
network that was trained for the robot as described.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from xml.etree import ElementTree

import numpy as np

from annik_core.model.artifact import Model
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.arm_kinematics import readable_kinematics
from annik_core.robots.corrections import (
    ArmCorrections,
    Deflection,
    JointHarmonics,
    PoseHarmonics,
)
from annik_core.robots.library import robot_from_definition
from annik_core.robots.robot import ForwardKinematics, Robot
from annik_core.robots.screw_chain import ScrewChain
from benchmarks.ik.peers.pose_matrix import roll_pitch_yaw
from benchmarks.ik.peers.problem import IkProblem
from benchmarks.ik.robot_problem import robot_problem
from benchmarks.ik.verification import Verifier

#: Sizes of the differences [m or rad]; of turns under the weight, per length of a lever [rad/m].
_PLACEMENT, _JOINT, _BEND, _COMPLIANCE = 5e-4, 1e-3, 5e-4, 1e-3
#: Most periods in one turn of a joint.
_ORDERS = 32


@dataclass(frozen=True, eq=False)
class CalibratedVerifier(Verifier):
    """Checks solutions by the forward kinematics of the calibrated robot, in NumPy."""

    kinematics: ForwardKinematics

    def errors(
        self, joint_positions: FloatArray, poses: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """See :meth:`benchmarks.ik.verification.Verifier.errors`."""
        distances, angles = np.full((2, len(poses)), np.nan)
        there = np.isfinite(joint_positions).all(axis=1)
        reached = self.kinematics.poses(joint_positions[there])
        distances[there], angles[there] = pose_distance(poses[there], reached)
        return distances, angles


def calibrated(model: Model, rng: np.random.Generator) -> Model:
    """The model of a robot with drawn differences."""
    robot = model.robot
    dof, box = robot.dof, robot.joint_box
    half_width = np.where(box.upper > box.lower, 0.5 * (box.upper - box.lower), 1.0)
    frequencies = np.where(robot.rotary, 1.0, 0.5 * np.pi / half_width)
    sines, cosines = _JOINT * rng.normal(size=(2, dof, _ORDERS)) / np.arange(1, _ORDERS + 1)
    waves = _waves(dof)
    bends = _BEND / np.sqrt(len(waves)) * rng.normal(size=(2, 6, len(waves)))
    corrections = ArmCorrections(
        _placements(dof, rng),
        joint_harmonics=JointHarmonics(frequencies, sines, cosines),
        deflection=Deflection(
            np.triu(_COMPLIANCE / dof * rng.uniform(size=(dof, dof))), np.array([0.0, 0.0, -1.0])
        ),
        pose_harmonics=PoseHarmonics(waves * frequencies, *bends),
    )
    definition = {**robot.definition, "corrections": corrections.to_dict()}
    return replace(model, robot=robot_from_definition(definition, "the calibrated robot's"))


def _waves(dof: int) -> FloatArray:
    """``(waves, dof)``: each joint with one and two periods, and each pair of joints."""
    joints = np.eye(dof)
    first, second = np.triu_indices(dof, 1)
    pairs = joints[first] + joints[second], joints[first] - joints[second]
    return np.concatenate([joints, 2.0 * joints, *pairs])


def _placements(dof: int, rng: np.random.Generator) -> FloatArray:
    """Drawn differences of links and axes ``(dof + 1, 7)``."""
    twists = _PLACEMENT * rng.normal(size=(dof + 1, 6))
    halves = np.hstack([0.5 * twists[:, 3:], np.ones((dof + 1, 1))])
    return np.hstack([twists[:, :3], halves / np.linalg.norm(halves, axis=1, keepdims=True)])


def calibrated_urdf(robot: Robot, rng: np.random.Generator) -> str:
    """The URDF of an arm with other lengths and angles."""
    chain, _ = _parts(robot)
    return _urdf(robot, chain.moved(_placements(robot.dof, rng)))


def without_kernel(model: Model) -> Model:
    """The same model, its forward kinematics in NumPy."""
    robot = model.robot
    return replace(model, robot=replace(robot, forward_kinematics=_readable(robot)))


def geometric_problem(robot: Robot) -> IkProblem:
    """The problem of a calibrated arm as far as a URDF can state it: its lengths and angles."""
    chain, corrections = _parts(robot)
    assert corrections is not None
    return replace(robot_problem(robot), urdf=_urdf(robot, chain.moved(corrections.placements)))


def calibrated_verifier(robot: Robot) -> Verifier:
    """By forward kinematics without the kernel."""
    return CalibratedVerifier(robot_problem(robot), _readable(robot))


def _readable(robot: Robot) -> ForwardKinematics:
    chain, corrections = _parts(robot)
    return readable_kinematics(
        robot.joint_names, chain, corrections, robot.turning, robot.joint_box.centre
    )


def _parts(robot: Robot) -> tuple[ScrewChain, ArmCorrections | None]:
    chain, data = ScrewChain.from_urdf(robot.definition["urdf"]), robot.definition
    if "corrections" not in data:
        return chain, None
    return chain, ArmCorrections.from_dict(data["corrections"], robot.dof, robot.name)


def _urdf(robot: Robot, chain: ScrewChain) -> str:
    root = ElementTree.Element("robot", name=robot.name)
    links = [robot.base_frame, *(f"{name}_link" for name in robot.joint_names)]
    links.append(robot.end_effector_frame)
    for link in links:
        ElementTree.SubElement(root, "link", name=link)
    names, kinds = (*robot.joint_names, "end"), (*robot.joint_types, "fixed")
    for index, placement in enumerate(chain.placements):
        joint = ElementTree.SubElement(root, "joint", name=names[index], type=kinds[index])
        ElementTree.SubElement(joint, "parent", link=links[index])
        ElementTree.SubElement(joint, "child", link=links[index + 1])
        angles = np.array(roll_pitch_yaw(placement[:3, :3]))
        ElementTree.SubElement(joint, "origin", xyz=_text(placement[:3, 3]), rpy=_text(angles))
        if index < robot.dof:
            linear, angular = chain.axes[index, :3], chain.axes[index, 3:]
            ElementTree.SubElement(joint, "axis", xyz=_text(angular if angular.any() else linear))
            lower, upper = robot.joint_limits.lower[index], robot.joint_limits.upper[index]
            ElementTree.SubElement(
                joint, "limit", lower=_text(lower), upper=_text(upper), effort="1", velocity="1"
            )
    return ElementTree.tostring(root, encoding="unicode")


def _text(numbers: FloatArray) -> str:
    """Numbers as a URDF has them, without loss."""
    return " ".join(map(repr, np.atleast_1d(numbers).tolist()))
