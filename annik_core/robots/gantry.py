"""The paper's robot: three translations and three rotations, each through a linear transmission.

Equations (1)-(4): every task coordinate is a drive angle times a transmission ratio plus an
offset. Orientation is roll, pitch, yaw (the paper's psi, theta, phi).

At a pitch of +-90 degrees only the difference (or the sum) of roll and yaw turns the end effector
(gimbal lock), and no function of the pose alone can be continuous there. :class:`GantryWorkspace`
then keeps roll and yaw as close as possible to those of the previous target, or to the middle of
the workspace. It gives the network a pose tilted by a tenth of a micro-radian, where both are
unique.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from operator import add, le, mul
from typing import Any

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import (
    FloatArray,
    Numbers,
    difference_of_numbers,
    pose_from_roll_pitch_yaw,
    quaternion_from_roll_pitch_yaw,
    roll_pitch_yaw,
)
from annik_core.robots.definition import checked_name, checked_numbers
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import (
    FULL_TURN,
    ForwardKinematics,
    ResolvedTarget,
    Robot,
    check_joint_count,
)

TASK_COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")

#: Rounding allowance at the faces of the workspace [m or rad].
EDGE_TOLERANCE = 1e-6
#: Closer than this to a pitch of +-90 degrees, roll and yaw count as not unique [rad]: there a
#: quaternion in single precision does not determine them.
GIMBAL_TOLERANCE = 1e-5
#: Least tilt off +-90 degrees of the pose that the network is then given [rad]; the exported graph
#: still separates roll and yaw at a tenth of it.
GIMBAL_TILT = 1e-7

_HALF_PI = 0.5 * np.pi
_ROLL, _PITCH, _YAW = 3, 4, 5


@dataclass(frozen=True, eq=False)
class GantryKinematics(ForwardKinematics):
    """Forward and inverse kinematics of the gantry, eq. (1)-(4).

    ``ratio`` ``(6,)`` is task coordinate per drive angle [m/rad], [rad/rad]; ``offset`` ``(6,)``
    are the task coordinates at drive angle zero [m], [rad].
    """

    joint_names: tuple[str, ...]
    ratio: FloatArray
    offset: FloatArray

    def task_coordinates(self, joint_positions: FloatArray) -> FloatArray:
        """``(n, 6)`` x, y, z [m], roll, pitch, yaw [rad] for drive angles ``(n, 6)``: eq. (1)-(2).

        Raises:
            WrongShape: if the array is not ``(n, 6)``.
        """
        check_joint_count(joint_positions, self.joint_names)
        return joint_positions * self.ratio + self.offset

    def joint_positions(self, task_coordinates: FloatArray) -> FloatArray:
        """Drive angles ``(n, 6)`` [rad] for task coordinates ``(n, 6)``: eq. (3)-(4)."""
        return (task_coordinates - self.offset) / self.ratio

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """End-effector poses ``(n, 7)``; see :class:`ForwardKinematics`."""
        task = self.task_coordinates(joint_positions)
        if len(task) == 1:
            # In plain floats, a tenth of the time: it is on the hot path.
            x, y, z, *angles = task[0].tolist()
            return np.array([[x, y, z, *quaternion_from_roll_pitch_yaw(*angles)]])
        return pose_from_roll_pitch_yaw(task[:, :3], task[:, 3:])

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """Geometric Jacobians ``(n, 6, 6)``; see :class:`ForwardKinematics`."""
        task = self.task_coordinates(joint_positions)
        pitch, yaw = task[:, 4], task[:, 5]
        jacobians = np.zeros((len(task), 6, 6))
        jacobians[:, :3, :3] = np.diag(self.ratio[:3])
        # The roll axis is x turned by pitch and yaw, the pitch axis is y turned by yaw.
        jacobians[:, 3, 3] = np.cos(yaw) * np.cos(pitch) * self.ratio[3]
        jacobians[:, 4, 3] = np.sin(yaw) * np.cos(pitch) * self.ratio[3]
        jacobians[:, 5, 3] = -np.sin(pitch) * self.ratio[3]
        jacobians[:, 3, 4] = -np.sin(yaw) * self.ratio[4]
        jacobians[:, 4, 4] = np.cos(yaw) * self.ratio[4]
        jacobians[:, 5, 5] = self.ratio[5]
        return jacobians

    def residuals(self, joint_positions: FloatArray, target: FloatArray) -> tuple[float, float]:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.residuals`."""
        ratios, offsets = self._transmissions
        x, y, z, roll, pitch, yaw = map(add, map(mul, joint_positions.tolist(), ratios), offsets)
        quaternion = quaternion_from_roll_pitch_yaw(roll, pitch, yaw)
        position, rotation = difference_of_numbers(target.tolist(), [x, y, z, *quaternion])
        return math.hypot(*position), math.hypot(*rotation)

    @cached_property
    def _transmissions(self) -> tuple[list[float], list[float]]:
        return self.ratio.tolist(), self.offset.tolist()


@dataclass(frozen=True, eq=False)
class GantryWorkspace:
    """The box of task coordinates, ``(6,)`` in [m] and [rad], that the joint box reaches."""

    kinematics: GantryKinematics
    lower: FloatArray
    upper: FloatArray

    def reference(self, joint_positions: FloatArray) -> FloatArray:
        """Roll, pitch, yaw ``(3,)`` [rad] at joint positions ``(6,)``."""
        task = self.kinematics.task_coordinates(joint_positions[np.newaxis])
        return task[0, 3:]

    def resolve(self, pose: FloatArray, reference: Numbers | None) -> ResolvedTarget:
        """See :meth:`Workspace.resolve`; the reference is roll, pitch, yaw."""
        x, y, z, *quaternion = pose.tolist()
        angles = roll_pitch_yaw(quaternion)
        if _HALF_PI - abs(angles[1]) >= GIMBAL_TOLERANCE:
            return ResolvedTarget(pose, self._violation([x, y, z, *angles]), angles)
        if reference is None:
            reference = 0.5 * (self.lower[3:] + self.upper[3:])
        tilted = _tilted_off_the_edge(angles, reference, self.lower[3:], self.upper[3:])
        numbers = tilted.tolist()
        pose = np.array([x, y, z, *quaternion_from_roll_pitch_yaw(*numbers)])
        return ResolvedTarget(pose, self._violation([x, y, z, *numbers]), tilted)

    def plainly_inside(self, poses: FloatArray) -> NDArray[np.bool_]:
        """None: each needs its reference."""
        return np.zeros(len(poses), dtype=np.bool_)

    def _violation(self, task: list[float]) -> str | None:
        least, greatest = self._least_tolerated
        if all(map(le, least, task)) and all(map(le, task, greatest)):
            return None
        # The closer the pitch is to the edge, the more a rounded quaternion changes roll and yaw.
        turning = EDGE_TOLERANCE / max(math.cos(task[_PITCH]), GIMBAL_TOLERANCE)
        lower, upper = self._bounds
        for axis, value in enumerate(task):
            tolerance = turning if axis in (_ROLL, _YAW) else EDGE_TOLERANCE
            if not lower[axis] - tolerance <= value <= upper[axis] + tolerance:
                unit = "m" if axis < 3 else "rad"
                return (
                    f"{TASK_COORDINATES[axis]} is {value:.6g} {unit}, the workspace is "
                    f"[{lower[axis]:.6g}, {upper[axis]:.6g}] {unit}"
                )
        return None

    @cached_property
    def _bounds(self) -> tuple[list[float], list[float]]:
        return self.lower.tolist(), self.upper.tolist()

    @cached_property
    def certainly_inside(self) -> FloatArray:
        """Bounds ``(2, 6)`` between which task coordinates are in the workspace at any pitch."""
        return np.array([self.lower - EDGE_TOLERANCE, self.upper + EDGE_TOLERANCE])

    @cached_property
    def _least_tolerated(self) -> list[list[float]]:
        least_tolerated: list[list[float]] = self.certainly_inside.tolist()
        return least_tolerated


def _tilted_off_the_edge(
    angles: Numbers, reference: Numbers, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Roll, pitch, yaw of the same pose nearest to the reference, the pitch just off +-90 degrees.

    Roll and yaw between ``lower`` and ``upper`` are preferred, if there are any.
    """
    roll, pitch, yaw = angles
    side = 1.0 if pitch > 0 else -1.0
    # At the edge only this combination turns the end effector; it is known up to full turns.
    combined = yaw - side * roll
    wanted = reference[2] - side * reference[0]
    nearest = combined + FULL_TURN * np.round((wanted - combined) / FULL_TURN)
    candidates = []
    for turned in nearest + FULL_TURN * np.array([0.0, -1.0, 1.0]):
        candidate_roll = reference[0] - side * 0.5 * (turned - wanted)
        # The rolls that keep both angles inside, yaw being turned + side * roll.
        yaw_bounds = sorted((side * (lower[2] - turned), side * (upper[2] - turned)))
        least, greatest = max(lower[0], yaw_bounds[0]), min(upper[0], yaw_bounds[1])
        inside = least <= greatest + EDGE_TOLERANCE
        if inside:
            candidate_roll = min(max(candidate_roll, least), greatest)
        distance = abs(candidate_roll - reference[0])
        candidates.append((not inside, distance, candidate_roll, turned))
    _, _, roll, combined = min(candidates)
    tilted = min(abs(pitch), _HALF_PI - GIMBAL_TILT)
    return np.array([roll, side * tilted, combined + side * roll])


def gantry_from_definition(definition: Mapping[str, Any], source: str) -> Robot:
    """The gantry that a definition describes.

    Its entries are ``name``, ``base_frame``, ``end_effector_frame`` and ``joints``, a list of six
    in the order of :data:`TASK_COORDINATES`, each with ``name``, ``limits``, ``box`` (pairs, drive
    angle [rad]), ``ratio`` and ``offset``. Errors call the definition ``source``.

    Raises:
        InvalidRobotDefinition: naming what is missing or wrong.
    """
    try:
        joints = list(definition["joints"])
        names = tuple(checked_name(joint["name"], "a joint's name", source) for joint in joints)
        limits, box, ratio, offset = (
            checked_numbers([joint[key] for joint in joints], key, source)
            for key in ("limits", "box", "ratio", "offset")
        )
        name, base_frame, end_effector_frame = (
            checked_name(definition[key], key, source)
            for key in ("name", "base_frame", "end_effector_frame")
        )
    except KeyError as error:
        raise InvalidRobotDefinition(source, f"{error} is missing") from error
    except TypeError as error:
        raise InvalidRobotDefinition(source, f"malformed: {error}") from error
    shapes = [entry.shape for entry in (limits, box, ratio, offset)]
    if shapes != [(6, 2), (6, 2), (6,), (6,)]:
        raise InvalidRobotDefinition(
            source,
            "a gantry has six joints, each with 'limits' and 'box' as [lower, upper], 'ratio' "
            "and 'offset' as one number",
        )
    if len(set(names)) != len(names):
        raise InvalidRobotDefinition(source, f"joint names are not unique: {', '.join(names)}")
    if not (np.isfinite(ratio).all() and np.isfinite(offset).all() and (ratio != 0).all()):
        raise InvalidRobotDefinition(source, "every ratio must be finite and not 0")
    joint_limits = JointLimits.from_bounds(names, limits[:, 0], limits[:, 1])
    joint_box = JointLimits.from_bounds(names, box[:, 0], box[:, 1])
    if not (joint_limits.contains(joint_box.lower) and joint_limits.contains(joint_box.upper)):
        raise InvalidRobotDefinition(source, "a joint's box is not inside its limits")
    kinematics = GantryKinematics(names, ratio, offset)
    with np.errstate(over="ignore", invalid="ignore"):
        corners = kinematics.task_coordinates(np.stack([joint_box.lower, joint_box.upper]))
    if not np.isfinite(corners).all():
        raise InvalidRobotDefinition(source, "a ratio or offset is too large: no finite workspace")
    workspace = GantryWorkspace(kinematics, corners.min(axis=0), corners.max(axis=0))
    if max(abs(workspace.lower[_PITCH]), abs(workspace.upper[_PITCH])) > _HALF_PI + 1e-9:
        raise InvalidRobotDefinition(
            source, "the pitch leaves [-90, 90] degrees: beyond it roll and yaw are not unique"
        )
    if np.abs(corners[:, [_ROLL, _YAW]]).max() > np.pi + 1e-9:
        # A pose does not tell an angle from the same after a full turn.
        raise InvalidRobotDefinition(
            source, "the roll or yaw leaves [-180, 180] degrees: poses beyond it would be refused"
        )
    return Robot(
        name=name,
        kind="gantry",
        joint_names=names,
        joint_types=("revolute",) * 6,
        joint_limits=joint_limits,
        joint_box=joint_box,
        base_frame=base_frame,
        end_effector_frame=end_effector_frame,
        forward_kinematics=kinematics,
        workspace=workspace,
        definition=definition,
    )
