"""Forward kinematics of arms: compiled where the kernel can be used, otherwise in NumPy."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.kernel import compiled_kernel
from annik_core.pose import FloatArray, rotation_matrix
from annik_core.robots.corrections import (
    ArmCorrections,
    Deflection,
    JointCorrection,
    PoseHarmonics,
    PoseNetwork,
    diagonal,
)
from annik_core.robots.robot import (
    ForwardKinematics,
    Linearisation,
    check_joint_count,
    unwrapped,
)
from annik_core.robots.screw_chain import ScrewChain

#: Below this angle [rad] a series replaces a quotient of two small numbers.
_SMALL = 1e-3
_NEXT, _AFTER = [1, 2, 0], [2, 0, 1]


def arm_kinematics(
    joint_names: tuple[str, ...],
    chain: ScrewChain,
    corrections: ArmCorrections | None = None,
    turning: Sequence[int] = (),
    centre: FloatArray | float = 0.0,
) -> ForwardKinematics:
    """Forward kinematics of a chain with the corrections of a calibration.

    Corrections are known in one turn of the joints ``turning``, that around ``centre``, ``(dof,)``
    or one number [rad], and the same in every other.
    """
    kernel = compiled_kernel()
    if kernel is None:
        return readable_kinematics(joint_names, chain, corrections, turning, centre)
    moved = chain if corrections is None else chain.moved(corrections.placements)
    compiled = kernel.Chain(
        moved.placements,
        chain.axes,
        corrections,
        chain.placements,
        _wrapped(corrections, turning),
        np.broadcast_to(centre, (len(chain.axes),)),
    )
    return CompiledKinematics(joint_names, compiled)


def readable_kinematics(
    joint_names: tuple[str, ...],
    chain: ScrewChain,
    corrections: ArmCorrections | None = None,
    turning: Sequence[int] = (),
    centre: FloatArray | float = 0.0,
) -> ForwardKinematics:
    """:func:`arm_kinematics` in NumPy, whether the kernel can be used or not."""
    if corrections is None:
        return ArmKinematics(joint_names, chain)
    kinematics: ForwardKinematics = ArmKinematics(joint_names, chain.moved(corrections.placements))
    joint: list[JointCorrection] = [
        part
        for part in (corrections.joint_harmonics, corrections.joint_networks)
        if part is not None
    ]
    if corrections.deflection is not None:
        joint.append(GravityDeflection(chain, corrections.deflection))
    if joint:
        kinematics = JointCorrectedKinematics(kinematics, SumOfCorrections(joint))
    for motion in (corrections.pose_harmonics, corrections.pose_network):
        if motion is not None:
            kinematics = PoseCorrectedKinematics(kinematics, motion)
    wrapped = _wrapped(corrections, turning)
    if wrapped:
        kinematics = JointCorrectedKinematics(kinematics, OneTurn(centre, wrapped))
    return kinematics


def _wrapped(corrections: ArmCorrections | None, turning: Sequence[int]) -> Sequence[int]:
    """The joints that are taken into one turn, outside of which networks are not known."""
    if corrections is None:
        return ()
    networks = corrections.joint_networks, corrections.pose_network
    return () if networks == (None, None) else turning


@dataclass(frozen=True, eq=False)
class CompiledKinematics(ForwardKinematics):
    """Forward kinematics of an arm in the compiled kernel, with all its corrections."""

    joint_names: tuple[str, ...]
    compiled: Any

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        check_joint_count(joint_positions, self.joint_names)
        poses: FloatArray = self.compiled.poses(joint_positions)
        return poses

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        check_joint_count(joint_positions, self.joint_names)
        jacobians: FloatArray = self.compiled.jacobians(joint_positions)
        return jacobians

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        return Linearisation(*self.compiled.linearise(joint_positions, target))

    def residuals(self, joint_positions: FloatArray, target: FloatArray) -> tuple[float, float]:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.residuals`."""
        residuals: tuple[float, float] = self.compiled.residuals(joint_positions, target)
        return residuals


@dataclass(frozen=True, eq=False)
class ArmKinematics(ForwardKinematics):
    """Forward kinematics of a chain in NumPy: the reference of the compiled kernel."""

    joint_names: tuple[str, ...]
    chain: ScrewChain

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        from scipy.spatial.transform import Rotation

        check_joint_count(joint_positions, self.joint_names)
        last = self.chain.frames(joint_positions)[-1]
        quaternions = Rotation.from_matrix(last[:, :3, :3]).as_quat(canonical=True)
        return np.concatenate([last[:, :3, 3], quaternions], axis=1)

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        check_joint_count(joint_positions, self.joint_names)
        return self._jacobians(self.chain.frames(joint_positions))

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        frames = self.chain.frames(joint_positions)
        axes = frames[-1, :3, :3].T
        jacobian = self._jacobians(frames)
        displacement = axes @ (target[:3] - frames[-1, :3, 3])
        return Linearisation(
            _logarithm(axes @ rotation_matrix(target[3:]), displacement),
            np.concatenate([axes @ jacobian[:3], axes @ jacobian[3:]]),
            displacement,
        )

    def _jacobians(self, frames: FloatArray) -> FloatArray:
        """``(..., 6, dof)`` in the axes of the base frame."""
        joints, end = frames[:-1], frames[-1]
        rotations = np.moveaxis(joints[..., :3, :3], 0, -3)
        linear, angular = (
            (rotations @ self.chain.axes[:, part, np.newaxis])[..., 0]
            for part in (slice(0, 3), slice(3, 6))
        )
        levers = np.moveaxis(end[..., :3, 3] - joints[..., :3, 3], 0, -2)
        # As np.cross, which takes longer to be called than to compute.
        linear = linear + (
            angular[..., _NEXT] * levers[..., _AFTER] - angular[..., _AFTER] * levers[..., _NEXT]
        )
        return np.concatenate([linear, angular], axis=-1).swapaxes(-1, -2)


def _logarithm(rotation: FloatArray, position: FloatArray) -> FloatArray:
    """The twist ``(6,)`` whose exponential, in SE(3), is a rotation ``(3, 3)`` and position."""
    a, b, c, w = _quaternion(rotation)
    x, y, z = position.tolist()
    sine = math.hypot(a, b, c)
    angle = 2.0 * math.atan2(sine, w)
    scale = angle / sine if sine > 0.0 else 2.0
    a, b, c = scale * a, scale * b, scale * c
    if angle < _SMALL:
        factor = 1.0 / 12.0 + angle * angle / 720.0
    else:
        factor = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / (angle * angle)
    d, e, f = b * z - c * y, c * x - a * z, a * y - b * x
    return np.array(
        [
            x - 0.5 * d + factor * (b * f - c * e),
            y - 0.5 * e + factor * (c * d - a * f),
            z - 0.5 * f + factor * (a * e - b * d),
            *(a, b, c),
        ]
    )


def _quaternion(rotation: FloatArray) -> list[float]:
    """Unit quaternion x, y, z, w, w >= 0, of a rotation ``(3, 3)``, from its largest part."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    squares = [1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz]
    quaternion = (
        [squares[0], xy + yx, xz + zx, zy - yz],
        [xy + yx, squares[1], yz + zy, xz - zx],
        [xz + zx, yz + zy, squares[2], yx - xy],
        [zy - yz, xz - zx, yx - xy, squares[3]],
    )[squares.index(max(squares))]
    norm = math.copysign(math.hypot(*quaternion), quaternion[3])
    return [part / norm for part in quaternion]


@dataclass(frozen=True, eq=False)
class JointCorrectedKinematics(ForwardKinematics):
    """Forward kinematics as a function of commanded instead of actual joint positions."""

    kinematics: ForwardKinematics
    correction: JointCorrection

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return self.kinematics.poses(self.correction.actual(joint_positions))

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        jacobians = self.kinematics.jacobians(self.correction.actual(joint_positions))
        product: FloatArray = jacobians @ self.correction.derivatives(joint_positions)
        return product

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        actual = self.correction.actual(joint_positions)
        found = self.kinematics.linearise(actual, target)
        found.jacobian = found.jacobian @ self.correction.derivatives(joint_positions)
        return found


@dataclass(frozen=True, eq=False)
class PoseCorrectedKinematics(ForwardKinematics):
    """Forward kinematics followed by a small motion of the end effector in its own frame.

    The Jacobians are those without the motion, whose derivative is a thousand times smaller than
    the pose's: a refinement takes no more steps.
    """

    kinematics: ForwardKinematics
    part: PoseNetwork | PoseHarmonics

    def poses(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return _moved(self.kinematics.poses(joint_positions), self.part.motions(joint_positions))

    def jacobians(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.robot.ForwardKinematics`."""
        return self.kinematics.jacobians(joint_positions)

    def linearise(self, joint_positions: FloatArray, target: FloatArray) -> Linearisation:
        """See :meth:`annik_core.robots.robot.ForwardKinematics.linearise`."""
        # The target is reached with the motion where the target moved back is reached without it.
        motion = self.part.motions(joint_positions[np.newaxis])
        moved = _moved(target[np.newaxis], motion, reverse=True)[0]
        return self.kinematics.linearise(joint_positions, moved)


@dataclass(frozen=True, eq=False)
class OneTurn(JointCorrection):
    """Continuous joints in the turn around ``centre``, in which corrections are known."""

    centre: FloatArray | float
    turning: Sequence[int]

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        return unwrapped(joint_positions, self.centre, self.turning)

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        return diagonal(np.ones_like(joint_positions))


@dataclass(frozen=True, eq=False)
class SumOfCorrections(JointCorrection):
    """Corrections as functions of the commanded joint positions, added."""

    corrections: Sequence[JointCorrection]

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        return joint_positions + sum(
            correction.actual(joint_positions) - joint_positions for correction in self.corrections
        )

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        identity = np.eye(joint_positions.shape[-1])
        return identity + sum(
            correction.derivatives(joint_positions) - identity for correction in self.corrections
        )


@dataclass(frozen=True, eq=False)
class GravityDeflection(JointCorrection):
    """A deflection of a chain, the nominal one."""

    chain: ScrewChain
    part: Deflection

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        moments = gravity_moments(self.chain, joint_positions, self.part.gravity)
        deflections: FloatArray = (moments * self.part.compliances).sum(-1)
        return joint_positions + deflections

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        axes, origins = _axes_and_origins(self.chain, joint_positions)
        dof, gravity = len(self.chain.axes), self.part.gravity
        turns = np.any(self.chain.axes[:, 3:] != 0.0, axis=1)
        # By joint that yields, then by joint that moves: the places after both.
        compliances = np.triu(self.part.compliances) * turns[:, np.newaxis]
        tails = _sums_from(compliances)
        levers = _sums_from(np.einsum("jk,k...->jk...", compliances, origins[1:]))
        levers -= np.einsum("jm,m...->jm...", tails, origins[:-1])
        # The moment of a place that shifts: axis . (shift x gravity) = shift . (gravity x axis).
        across = np.cross(gravity, axes)
        changes = np.cross(levers, across[:, np.newaxis])
        changes[:, ~turns] = np.einsum("jm,j...->jm...", tails[:, ~turns], across)
        own = levers[range(dof), range(dof)]
        # A joint before turns the axis too.
        before = np.cross(own, across) + np.cross(axes, np.cross(own, gravity))
        for joint in range(dof):
            for moved in range(joint):
                changes[joint, moved] = before[joint] if turns[moved] else 0.0
        derivatives = np.moveaxis((changes * axes).sum(-1), (0, 1), (-2, -1))
        return np.asarray(np.eye(dof) + derivatives)


def _sums_from(values: FloatArray) -> FloatArray:
    """Sums ``(n, m, ...)`` over the second index, from each on."""
    return np.cumsum(values[:, ::-1], axis=1)[:, ::-1]


def gravity_moments(
    chain: ScrewChain, joint_positions: FloatArray, gravity: FloatArray
) -> FloatArray:
    """Moments ``(..., dof, dof)`` [m] about each axis of unit forces along the gravity.

    The forces are at the places of :class:`annik_core.robots.corrections.Deflection`; those before
    the joint, and those about prismatic joints, are zero.
    """
    axes, origins = _axes_and_origins(chain, joint_positions)
    levers = origins[np.newaxis, 1:] - origins[:-1, np.newaxis]
    # axis . (lever x gravity) = lever . (gravity x axis).
    moments = (levers * np.cross(gravity, axes)[:, np.newaxis]).sum(-1)
    turns = np.any(chain.axes[:, 3:] != 0.0, axis=1)
    there = np.triu(np.ones(moments.shape[:2])) * turns[:, np.newaxis]
    return np.asarray(np.moveaxis(moments, (0, 1), (-2, -1)) * there)


def _axes_and_origins(
    chain: ScrewChain, joint_positions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Axes ``(dof, ..., 3)`` and origins ``(dof + 1, ..., 3)`` in the base frame.

    The origins are those of the joints before their own motion, and last the end effector's.
    """
    frames = chain.frames(joint_positions)
    axes = np.stack(
        [
            frames[index, ..., :3, :3] @ (axis[3:] if np.any(axis[3:]) else axis[:3])
            for index, axis in enumerate(chain.axes)
        ]
    )
    origins = frames[..., :3, 3].copy()
    for index, axis in enumerate(chain.axes):
        if not np.any(axis[3:]):
            origins[index] -= joint_positions[..., index, np.newaxis] * axes[index]
    return axes, origins


def _moved(poses: FloatArray, motions: FloatArray, *, reverse: bool = False) -> FloatArray:
    """Poses ``(n, 7)`` moved by twists ``(n, 6)`` in their own frames, or back by them.

    The twists are so small that half the cross product is the exponential's coupling of rotation
    and translation, to 1e-9 m.
    """
    from scipy.spatial.transform import Rotation

    linear, angular = motions[:, :3], motions[:, 3:]
    linear = linear + 0.5 * np.cross(angular, linear)
    turn = Rotation.from_rotvec(angular)
    if reverse:
        turn = turn.inv()
        linear = -turn.apply(linear)
    before = Rotation.from_quat(poses[:, 3:])
    return np.concatenate(
        [poses[:, :3] + before.apply(linear), (before * turn).as_quat(canonical=True)], axis=1
    )
