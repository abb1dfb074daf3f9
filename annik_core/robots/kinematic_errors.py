"""Geometric errors of an arm: the ways in which it can differ from its description.

The Denavit-Hartenberg parameters as small motions of all links that follow a joint: along and
about its axis (offset and zero of the joint), along and about the common normal to the next axis
(length and twist of the link). These four are incomplete for parallel axes [Hayati1983]_, for the
base and for the tool; what they leave out is an error of alignment.

References:
    [Hayati1983] S. A. Hayati: Robot arm geometric link parameter estimation. IEEE Conference on
    Decision and Control, 1983.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain

#: Axes this near to parallel count as parallel [rad]: their common normal is far away, or, where a
#: description rounds its angles as in rpy="3.1416 0 0", arbitrary.
_PARALLEL = 0.02
#: Axes this near to each other count as crossing [m].
_CROSSING = 1e-6


class ErrorKind(Enum):
    """Kinds of geometric errors, in the order in which the motions at one place are applied."""

    ALIGNMENT_OF_BASE = "alignment of the base"
    JOINT_ZERO = "zero"
    JOINT_OFFSET = "offset along the axis"
    LINK_LENGTH = "length of the link after it"
    LINK_TWIST = "twist of the link after it"
    LINK_ALIGNMENT = "alignment of the link after it"
    TOOL_ALIGNMENT = "alignment of the end effector"


@dataclass(frozen=True, eq=False)
class GeometricError:
    """One small motion of all links that follow a place of the chain.

    Attributes:
        name: the kind in words, with the joint's name.
        place: 0: before the first joint, in the base frame; i: after the i-th joint, in its frame.
        is_rotation: whether it is a rotation [rad] or a translation [m].
        direction: ``(3,)`` unit vector.
        point: ``(3,)`` a point of the rotation axis [m].
    """

    name: str
    kind: ErrorKind
    place: int
    is_rotation: bool
    direction: FloatArray
    point: FloatArray

    def motion(self, amount: float) -> FloatArray:
        """The motion ``(4, 4)`` by an amount [rad or m]."""
        motion = np.eye(4)
        if not self.is_rotation:
            motion[:3, 3] = amount * self.direction
            return motion
        x, y, z = self.direction
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        turn = np.eye(3) + np.sin(amount) * cross + (1.0 - np.cos(amount)) * cross @ cross
        motion[:3, :3] = turn
        motion[:3, 3] = self.point - turn @ self.point
        return motion


def geometric_errors(robot: Robot) -> tuple[GeometricError, ...]:
    """All geometric errors of an arm, in the order from the base to the end effector."""
    chain = ScrewChain.from_urdf(robot.definition["urdf"])
    errors = _base_errors(chain, robot.joint_names[0])
    for number, joint in enumerate(robot.joint_names, 1):
        errors += _joint_errors(chain, number, joint)
    return tuple(errors)


def placements_of(
    errors: Sequence[GeometricError], amounts: Sequence[float] | FloatArray, dof: int
) -> FloatArray:
    """The motions ``(dof + 1, 7)`` of errors, in their order, by amounts [rad or m]."""
    motions = np.tile(np.eye(4), (dof + 1, 1, 1))
    for error, amount in zip(errors, amounts, strict=True):
        motions[error.place] = motions[error.place] @ error.motion(float(amount))
    return motion_poses(motions)


def motion_poses(motions: FloatArray) -> FloatArray:
    """Motions ``(n, 4, 4)`` as poses ``(n, 7)``."""
    from scipy.spatial.transform import Rotation

    quaternions = Rotation.from_matrix(motions[:, :3, :3]).as_quat(canonical=True)
    return np.concatenate([motions[:, :3, 3], quaternions], axis=1)


def _base_errors(chain: ScrewChain, joint: str) -> list[GeometricError]:
    """Position and direction of the first axis, in the two directions across it."""
    placement, (_, direction) = chain.placements[0], _axis(chain, 0)
    axis = placement[:3, :3] @ direction
    return [
        GeometricError(
            f"base: {'tilt' if is_rotation else 'shift'} of {joint}'s axis, {which} direction",
            ErrorKind.ALIGNMENT_OF_BASE,
            0,
            is_rotation,
            across,
            placement[:3, 3],
        )
        for which, across in zip(("first", "second"), _across(axis), strict=True)
        for is_rotation in (False, True)
    ]


def _joint_errors(chain: ScrewChain, number: int, joint: str) -> list[GeometricError]:
    point, direction = _axis(chain, number - 1)
    foot, normal = _common_normal(chain, number)
    binormal = np.cross(direction, normal)
    last = number == len(chain.axes)
    alignment = ErrorKind.TOOL_ALIGNMENT if last else ErrorKind.LINK_ALIGNMENT
    rows = [
        (ErrorKind.JOINT_ZERO, True, direction, point),
        (ErrorKind.JOINT_OFFSET, False, direction, point),
        (ErrorKind.LINK_LENGTH, False, normal, foot),
        (ErrorKind.LINK_TWIST, True, normal, foot),
        (alignment, True, binormal, foot),
    ]
    if last:
        rows.append((alignment, False, binormal, foot))
    return [
        GeometricError(
            f"{joint}: {kind.value}"
            + (f" ({'tilt' if is_rotation else 'shift'})" if kind is alignment else ""),
            kind,
            number,
            is_rotation,
            along,
            through,
        )
        for kind, is_rotation, along, through in rows
    ]


def _axis(chain: ScrewChain, index: int) -> tuple[FloatArray, FloatArray]:
    """A point of a joint's axis and its direction, in the joint's frame."""
    linear, angular = chain.axes[index, :3], chain.axes[index, 3:]
    return np.zeros(3), angular if np.any(angular) else linear


def _common_normal(chain: ScrewChain, number: int) -> tuple[FloatArray, FloatArray]:
    """Foot and direction of the common normal from a joint's axis to the next, in its frame.

    That of the last joint is at the end effector.
    """
    _, axis = _axis(chain, number - 1)
    placement = chain.placements[number]
    origin = placement[:3, 3]
    if number == len(chain.axes):
        return origin, _across(axis)[0]
    next_axis = placement[:3, :3] @ _axis(chain, number)[1]
    normal = np.cross(axis, next_axis)
    sine = float(np.linalg.norm(normal))
    if sine > _PARALLEL:
        # The point of the axis that is nearest to the next one.
        along = float(np.cross(origin, next_axis) @ normal) / sine**2
        return along * axis, normal / sine
    across = origin - float(origin @ axis) * axis
    distance = float(np.linalg.norm(across))
    return np.zeros(3), across / distance if distance > _CROSSING else _across(axis)[0]


def _across(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that are perpendicular to an axis and to each other."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)
