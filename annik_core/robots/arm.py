"""Arms: serial chains from URDFs."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import dist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray, Numbers
from annik_core.robots.arm_kinematics import arm_kinematics
from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.definition import checked_interval, checked_name, number_text
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import (
    FULL_TURN,
    NO_REFERENCE,
    TURN_TOLERANCE,
    ResolvedTarget,
    Robot,
    turning_joints,
)
from annik_core.robots.screw_chain import ScrewChain
from annik_core.robots.urdf import SerialChain, serial_chain

#: Most moving joints of an arm.
MAX_JOINTS = 32


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
        return ResolvedTarget(pose, violation, NO_REFERENCE)

    def plainly_inside(self, poses: FloatArray) -> NDArray[np.bool_]:
        """See :meth:`annik_core.robots.robot.Workspace.plainly_inside`."""
        with np.errstate(over="ignore", invalid="ignore"):
            distances = np.linalg.norm(poses[:, :3] - self.centre, axis=1)
        inside: NDArray[np.bool_] = distances <= self.certain_reach
        return inside

    @property
    def certain_reach(self) -> float:
        """A distance [m] that :meth:`resolve` takes to be inside, however it is rounded."""
        return self.reach * (1.0 - 1e-12)

    @cached_property
    def _centre(self) -> list[float]:
        coordinates: list[float] = self.centre.tolist()
        return coordinates

    def reference(self, joint_positions: FloatArray) -> Numbers:
        """Empty: an arm's solution needs no reference."""
        return NO_REFERENCE


def arm_from_definition(definition: Mapping[str, Any], source: str) -> Robot:
    """The arm that a definition describes; its own definition has the chain alone as URDF.

    Besides ``urdf``, the text, a definition may have ``name``, ``base_frame`` and
    ``end_effector_frame`` (see :func:`serial_chain`), ``corrections`` (see
    :class:`annik_core.robots.corrections.ArmCorrections`), and ``joint_box``, [lower, upper] of
    joints by name [rad or m], by default a joint's limits, or, where they are wider, the full turn
    in their middle. Errors call the definition ``source``.

    Raises:
        InvalidRobotDefinition: naming what is missing or wrong.
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
    screws = ScrewChain.from_urdf(chain.urdf)
    return Robot(
        name=name,
        kind="arm",
        joint_names=chain.joint_names,
        joint_types=chain.joint_types,
        joint_limits=limits,
        joint_box=box,
        base_frame=chain.base_frame,
        end_effector_frame=chain.end_effector_frame,
        forward_kinematics=arm_kinematics(
            chain.joint_names, screws, corrections, turning_joints(chain.joint_types), box.centre
        ),
        workspace=_workspace(screws, chain, corrections),
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
        masses=chain.masses,
    )


def _joint_box(
    entries: Mapping[str, object], chain: SerialChain, limits: JointLimits, source: str
) -> JointLimits:
    """The given joint box, completed by the limits."""
    joints = ", ".join(chain.joint_names)
    for joint in entries:
        if joint not in chain.joint_names:
            raise InvalidRobotDefinition(
                source, f"'joint_box' names {joint!r}, which is no joint of the chain: {joints}"
            )
    lower, upper = limits.lower.copy(), limits.upper.copy()
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
    screws: ScrewChain, chain: SerialChain, corrections: ArmCorrections | None
) -> ArmWorkspace:
    if corrections is not None:
        screws = screws.moved(corrections.placements)
    origins = screws.frames(np.zeros(len(chain.joint_names)))[:, :3, 3]
    beyond, shift = np.zeros(len(chain.joint_names)), 0.0
    if corrections is not None:
        for part in (corrections.joint_networks, corrections.joint_harmonics):
            beyond = beyond + (0.0 if part is None else part.largest)
        for motion in (corrections.pose_harmonics, corrections.pose_network):
            shift += 0.0 if motion is None else motion.largest_shift
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
