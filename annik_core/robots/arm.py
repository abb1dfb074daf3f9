"""Arms: serial chains from URDFs, with kinematics by Pinocchio."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import dist
from typing import Any

import numpy as np

from annik_core.errors import MissingDependency, missing_dependency
from annik_core.pose import FloatArray, Numbers
from annik_core.robots.corrected_kinematics import (
    JointCorrectedKinematics,
    OneTurn,
    PoseCorrectedKinematics,
)
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.definition import checked_interval, checked_name, number_text
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import (
    FULL_TURN,
    TURN_TOLERANCE,
    ForwardKinematics,
    Linearisation,
    ResolvedTarget,
    Robot,
    check_joint_count,
    turning_joints,
)
from annik_core.robots.urdf import SerialChain, serial_chain

_PURPOSE = "the kinematics of arms"
_NO_REFERENCE: FloatArray = np.zeros(0)
#: Most moving joints of an arm.
MAX_JOINTS = 32


def _pinocchio() -> Any:
    try:
        import pinocchio
    except ImportError as error:
        raise missing_dependency(error, _PURPOSE) from error
    if not hasattr(pinocchio, "buildModelFromXML"):
        # Another project has this name on PyPI.
        other = "pip install pin; what is installed under this name is another project"
        raise MissingDependency("pinocchio", _PURPOSE, other)
    return pinocchio


@dataclass(frozen=True, eq=False)
class ArmKinematics(ForwardKinematics):
    """Forward kinematics of a serial chain.

    Not thread-safe: Pinocchio computes in memory of this object.

    Attributes:
        end_effector_frame: the link whose pose is meant; the base frame is the root of the chain.
        placements: as of :class:`annik_core.robots.corrections.ArmCorrections`, or None.
    """

    joint_names: tuple[str, ...]
    urdf: str
    end_effector_frame: str
    placements: FloatArray | None = None

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """End-effector poses ``(n, 7)``; see :class:`ForwardKinematics`."""
        check_joint_count(joint_positions, self.joint_names)
        pin, model, data, frame = self._pinocchio
        poses = np.empty((len(joint_positions), 7))
        for row, positions in enumerate(joint_positions):
            pin.framesForwardKinematics(model, data, positions)
            poses[row] = pin.SE3ToXYZQUAT(data.oMf[frame])
        poses[poses[:, 6] < 0.0, 3:] *= -1.0
        return poses

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Geometric Jacobians ``(n, 6, dof)``; see :class:`ForwardKinematics`."""
        check_joint_count(joint_positions, self.joint_names)
        pin, model, data, frame = self._pinocchio
        jacobians = np.empty((len(joint_positions), 6, len(self.joint_names)))
        for row, positions in enumerate(joint_positions):
            jacobians[row] = pin.computeFrameJacobian(
                model, data, positions, frame, pin.LOCAL_WORLD_ALIGNED
            )
        return jacobians

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        compute, arguments, placement, se3, log6 = self._body_jacobian
        model, data, frame, local = arguments
        jacobian = compute(model, data, joint_positions, frame, local)
        difference = placement.actInv(se3(target))
        return Linearisation(log6(difference).vector, jacobian, difference.translation)

    @cached_property
    def _body_jacobian(self) -> tuple[Any, ...]:
        """What :meth:`linearise` uses; it is on the hot path."""
        pin, model, data, frame = self._pinocchio
        # Computing the Jacobian leaves the frame's placement here.
        placement = data.iMf[0]
        return (
            pin.computeFrameJacobian,
            (model, data, frame, pin.LOCAL),
            placement,
            pin.XYZQUATToSE3,
            pin.log6,
        )

    def link_poses(self, joint_positions: FloatArray) -> dict[str, list[float]]:
        """Poses ``(7,)`` of all links but the base at joint positions ``(dof,)``."""
        pin, model, data, _ = self._pinocchio
        pin.framesForwardKinematics(model, data, joint_positions)
        return {
            frame.name: pin.SE3ToXYZQUAT(data.oMf[number]).tolist()
            for number, frame in enumerate(model.frames)
            if frame.type == pin.FrameType.BODY and frame.parentFrame
        }

    @cached_property
    def joint_origins(self) -> FloatArray:
        """``(dof + 1, 3)`` origins of the joints and of the end effector at zero position [m]."""
        pin, model, data, frame = self._pinocchio
        pin.framesForwardKinematics(model, data, np.zeros(len(self.joint_names)))
        joints = [data.oMi[number].translation.copy() for number in range(1, model.njoints)]
        return np.array([*joints, data.oMf[frame].translation.copy()])

    @cached_property
    def screws(self) -> "ScrewChain":
        """The chain as a product of screw motions."""
        pin, model, data, frame = self._pinocchio
        zero = np.zeros(len(self.joint_names))
        axes = [
            pin.computeJointJacobian(model, data, zero, number)[:, number - 1].copy()
            for number in range(1, model.njoints)
        ]
        placements = [model.jointPlacements[number] for number in range(1, model.njoints)]
        placements.append(model.frames[frame].placement)
        return ScrewChain(
            np.array([placement.homogeneous for placement in placements]), np.array(axes)
        )

    @cached_property
    def _pinocchio(self) -> tuple[Any, Any, Any, int]:
        """The library, the model, its data, and the number of the end-effector frame."""
        pin = _pinocchio()
        # Of a continuous joint Pinocchio would want the cosine and sine of its position.
        model = pin.buildModelFromXML(self.urdf.replace('type="continuous"', 'type="revolute"'))
        # Joints are frames too, and one may have the name of a link.
        frame = model.getFrameId(self.end_effector_frame, pin.FrameType.BODY)
        if self.placements is not None:
            first, *others, last = [pin.XYZQUATToSE3(row) for row in self.placements]
            model.jointPlacements[1] = first * model.jointPlacements[1]
            for number, motion in enumerate(others, 2):
                model.jointPlacements[number] = motion * model.jointPlacements[number]
            model.frames[frame].placement = last * model.frames[frame].placement
        data = model.createData()
        _check_placement(pin, model, data, frame)
        return pin, model, data, frame


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


def _check_placement(pin: Any, model: Any, data: Any, frame: int) -> None:
    """Refuse a Pinocchio that puts the placement elsewhere than its undocumented place today."""
    for position in (0.3, -0.7):
        positions = np.full(model.nq, position)
        pin.framesForwardKinematics(model, data, positions)
        expected = data.oMf[frame].copy()
        data.iMf[0] = pin.SE3.Identity()
        pin.computeFrameJacobian(model, data, positions, frame, pin.LOCAL)
        if not data.iMf[0].isApprox(expected, 1e-9):
            raise MissingDependency(
                "pinocchio",
                _PURPOSE,
                f"version {pin.__version__} computes Jacobians in another way; install 4.1",
            )


@dataclass(frozen=True, eq=False)
class ArmWorkspace:
    """A ball that contains every reachable position.

    Its centre ``(3,)`` is the origin of the first joint in the base frame; in [m].
    """

    centre: FloatArray
    reach: float

    def resolve(self, pose: FloatArray, reference: Numbers | None) -> ResolvedTarget:
        """See :meth:`annik_core.robots.robot.Workspace.resolve`; the pose is not changed."""
        distance = dist(pose.tolist()[:3], self._centre)
        violation = None
        if distance > self.reach:
            violation = (
                f"the target is {distance:.6g} m from the first joint, the arm reaches at most "
                f"{self.reach:.6g} m"
            )
        return ResolvedTarget(pose, violation, _NO_REFERENCE)

    @cached_property
    def _centre(self) -> list[float]:
        coordinates: list[float] = self.centre.tolist()
        return coordinates

    def reference(self, joint_positions: FloatArray) -> FloatArray:
        """Empty: an arm's solution needs no reference."""
        return _NO_REFERENCE


def arm_from_definition(definition: Mapping[str, Any], source: str) -> Robot:
    """The arm that a definition describes; its own definition has the chain alone as URDF.

    Besides ``urdf``, the text, a definition may have ``name``, ``base_frame`` and
    ``end_effector_frame`` (see :func:`serial_chain`), ``corrections`` (see
    :class:`annik_core.robots.corrections.ArmCorrections`), and ``joint_box``, [lower, upper] of
    joints by name [rad or m], by default a joint's limits, or, where they are wider, the full turn
    in their middle. Errors call the definition ``source``.

    Raises:
        InvalidRobotDefinition: naming what is missing or wrong.
        MissingDependency: if Pinocchio is not installed.
    """
    known = {
        *("kind", "name", "urdf", "base_frame", "end_effector_frame", "joint_box"),
        "corrections",
    }
    unknown = sorted(set(definition) - known)
    if unknown:
        raise InvalidRobotDefinition(
            source,
            f"{unknown[0]!r} is not an entry of an arm; those are {', '.join(sorted(known))}",
        )
    urdf = definition.get("urdf")
    if not isinstance(urdf, str):
        raise InvalidRobotDefinition(source, "'urdf' is missing: the text of a URDF")
    base, tip = (
        checked_name(definition[key], key, source) if definition.get(key) is not None else None
        for key in ("base_frame", "end_effector_frame")
    )
    entries = definition.get("joint_box") or {}
    if not isinstance(entries, Mapping):
        raise InvalidRobotDefinition(
            source, "'joint_box' is not a mapping of joint names to [lower, upper]"
        )
    chain = serial_chain(urdf, source, base, tip, entries)
    if len(chain.joint_names) > MAX_JOINTS:
        raise InvalidRobotDefinition(
            source, f"the chain has {len(chain.joint_names)} joints, more than {MAX_JOINTS}"
        )
    limits = JointLimits.from_bounds(chain.joint_names, chain.lower, chain.upper)
    box = _joint_box(entries, chain, limits, source)
    name = checked_name(definition.get("name", chain.name), "name", source)
    corrections = None
    if definition.get("corrections") is not None:
        corrections = ArmCorrections.from_dict(
            definition["corrections"], len(chain.joint_names), source
        )
    kinematics = ArmKinematics(
        chain.joint_names,
        chain.urdf,
        chain.end_effector_frame,
        None if corrections is None else corrections.placements,
    )
    try:
        workspace = _workspace(kinematics, chain, corrections)
    except ValueError as error:
        raise InvalidRobotDefinition(source, f"Pinocchio can't read the chain: {error}") from error
    return Robot(
        name=name,
        kind="arm",
        joint_names=chain.joint_names,
        joint_types=chain.joint_types,
        joint_limits=limits,
        joint_box=box,
        base_frame=chain.base_frame,
        end_effector_frame=chain.end_effector_frame,
        forward_kinematics=_corrected(kinematics, corrections, chain, box),
        workspace=workspace,
        definition={
            "kind": "arm",
            "name": name,
            "urdf": chain.urdf,
            "base_frame": chain.base_frame,
            "end_effector_frame": chain.end_effector_frame,
            "joint_box": {
                joint: [float(lower), float(upper)]
                for joint, lower, upper in zip(
                    chain.joint_names, box.lower, box.upper, strict=True
                )
            },
            **({} if corrections is None else {"corrections": corrections.to_dict()}),
        },
        error_bound=None if corrections is None else corrections.error_bound,
    )


def _corrected(
    kinematics: ArmKinematics,
    corrections: ArmCorrections | None,
    chain: SerialChain,
    box: JointLimits,
) -> ForwardKinematics:
    corrected: ForwardKinematics = kinematics
    if corrections is not None and corrections.joint_networks is not None:
        corrected = JointCorrectedKinematics(corrected, corrections.joint_networks)
    if corrections is not None and corrections.pose_network is not None:
        corrected = PoseCorrectedKinematics(corrected, corrections.pose_network)
    turning = turning_joints(chain.joint_types)
    if corrected is not kinematics and turning:
        return JointCorrectedKinematics(corrected, OneTurn(box.centre, turning))
    return corrected


def _joint_box(
    entries: Mapping[str, object], chain: SerialChain, limits: JointLimits, source: str
) -> JointLimits:
    """The given joint box, completed by the limits, soft ones where there are."""
    joints = ", ".join(chain.joint_names)
    for joint in entries:
        if joint not in chain.joint_names:
            raise InvalidRobotDefinition(
                source, f"'joint_box' names {joint!r}, which is no joint of the chain: {joints}"
            )
    lower, upper = np.array(chain.soft_lower), np.array(chain.soft_upper)
    for index, joint in enumerate(chain.joint_names):
        kind = chain.joint_types[index]
        if kind == "continuous":
            lower[index], upper[index] = -np.pi, np.pi
        if joint in entries:
            lower[index], upper[index] = checked_interval(entries[joint], kind, joint, source)
        if lower[index] < limits.lower[index] or upper[index] > limits.upper[index]:
            inner, outer = (
                f"[{number_text(bounds.lower[index])}, {number_text(bounds.upper[index])}]"
                for bounds in (JointLimits(chain.joint_names, lower, upper), limits)
            )
            raise InvalidRobotDefinition(
                source, f"joint_box of {joint} is {inner}, not inside its limits {outer}"
            )
        if kind != "prismatic" and upper[index] - lower[index] > FULL_TURN + TURN_TOLERANCE:
            # The pose is the same after a full turn, so that the limits stand for one.
            middle = 0.5 * (lower[index] + upper[index])
            given_less = lower[index] > limits.lower[index] or upper[index] < limits.upper[index]
            if joint in entries and given_less:
                raise InvalidRobotDefinition(
                    source, f"joint_box of {joint} is wider than a full turn: no single solution"
                )
            lower[index], upper[index] = middle - np.pi, middle + np.pi
    box = JointLimits.from_bounds(chain.joint_names, lower, upper)
    if len(box.free) == 0:
        raise InvalidRobotDefinition(source, "'joint_box' locks every joint: nothing moves")
    return box


def _workspace(
    kinematics: ArmKinematics, chain: SerialChain, corrections: ArmCorrections | None
) -> ArmWorkspace:
    origins = kinematics.joint_origins
    beyond, shift = np.zeros(len(chain.joint_names)), 0.0
    if corrections is not None and corrections.joint_networks is not None:
        beyond = corrections.joint_networks.largest
    if corrections is not None and corrections.pose_network is not None:
        shift = corrections.pose_network.largest_shift
    strokes = [
        max(abs(lower), abs(upper)) + more
        for kind, lower, upper, more in zip(
            chain.joint_types, chain.lower, chain.upper, beyond.tolist(), strict=True
        )
        if kind == "prismatic"
    ]
    # The distances between successive origins are fixed, except along prismatic joints.
    reach = float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum()) + sum(strokes) + shift
    return ArmWorkspace(origins[0], reach * (1.0 + 1e-9) + 1e-9)
