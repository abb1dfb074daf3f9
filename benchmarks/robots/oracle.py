"""Newton's method from random starts, and what a straight path needs, in NumPy alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
from benchmarks.ik.peers.serial_chain import SerialChain, joints_between
from benchmarks.ik.straight_paths import straight_line
from benchmarks.robots.folder import ArmFile

TURN = 2.0 * np.pi
#: Joints of two solutions differ by more than this, in one of them [rad or m].
_APART = 2e-3
#: A restart counts if it comes as near as this to the pose, in metres and radians together.
_POLISHED = 1e-11
_ITERATIONS = 60
#: Added to the diagonal, besides half the square of the error.
_DAMPING = 1e-13
#: Rounding of the limits [rad or m].
_EDGE = 1e-9
#: Steps in which a continuation goes from one point of a path to the next.
_SUBSTEPS = 20
#: Singular values below this share of the largest are rounding.
_ROUNDING = 1e-6
#: Singular values below this share of the largest count as zero, by the digits of a URDF.
_SINGULAR = 1e-4


@dataclass(frozen=True, eq=False)
class Oracle:
    """An arm by its URDF alone: kinematics, limits, restarts.

    Attributes:
        chain: its joints.
        lower: ``(dof,)`` limits; minus infinity for a continuous joint [rad or m].
        upper: ``(dof,)`` likewise.
    """

    chain: SerialChain
    lower: FloatArray
    upper: FloatArray

    @classmethod
    def of(cls, arm: ArmFile) -> Oracle:
        """The arm of a file."""
        frames = arm.base_frame, arm.end_effector_frame
        bounds = []
        for joint in joints_between(arm.urdf, *frames):
            limit = joint.find("limit")
            if joint.get("type") == "continuous":
                bounds.append((-np.inf, np.inf))
            elif joint.get("type") != "fixed":
                assert limit is not None  # otherwise annik has refused the arm
                low, high = float(limit.get("lower", 0)), float(limit.get("upper", 0))
                soft = joint.find("safety_controller")
                if soft is not None:
                    soft_low, soft_high = (
                        float(soft.get(f"soft_{end}_limit") or 0.0) for end in ("lower", "upper")
                    )
                    if soft_low != 0.0 or soft_high != 0.0:
                        low, high = max(low, soft_low), min(high, soft_high)
                bounds.append((low, high))
        lower, upper = np.array(bounds).T
        return cls(SerialChain.from_urdf(arm.urdf, *frames), lower, upper)

    @cached_property
    def turning(self) -> NDArray[np.bool_]:
        """``(dof,)``: which joints turn; the others slide."""
        return np.array([not joint.prismatic for joint in self.chain.joints])

    @cached_property
    def full_range(self) -> tuple[FloatArray, FloatArray]:
        """The limits, each joint at most a full turn about their middle."""
        middle = self._middle
        half = np.where(self.turning, np.minimum(0.5 * (self.upper - self.lower), np.pi), np.inf)
        return np.maximum(self.lower, middle - half), np.minimum(self.upper, middle + half)

    @cached_property
    def _middle(self) -> FloatArray:
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(self.lower), 0.5 * (self.lower + self.upper), 0.0)

    def sample(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Joint positions ``(n, dof)`` anywhere in the full range."""
        return rng.uniform(*self.full_range, (count, len(self.lower)))

    def poses(self, positions: FloatArray) -> FloatArray:
        """Poses ``(n, 7)`` of joint positions ``(n, dof)``."""
        tips = self.chain.tip_placements(positions)
        quaternions = Rotation.from_matrix(tips[:, :3, :3]).as_quat(canonical=True)
        return np.hstack([tips[:, :3, 3], quaternions])

    def within_limits(self, positions: FloatArray) -> NDArray[np.bool_]:
        """Which of ``(n, dof)`` are; ``(n,)``."""
        low, high = positions >= self.lower - _EDGE, positions <= self.upper + _EDGE
        return np.asarray((low & high).all(axis=1))

    def errors(self, positions: FloatArray, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances [m] and angles [rad] from poses ``(n, 7)``, each ``(n,)``."""
        twists = self._linearised(positions, poses)[0]
        return np.linalg.norm(twists[:, :3], axis=1), np.linalg.norm(twists[:, 3:], axis=1)

    def refined(self, starts: FloatArray, pose: FloatArray) -> FloatArray:
        """The starts ``(n, dof)`` that lead to a pose ``(7,)``, where they end.

        Turning joints have no bounds in an arm of up to six joints: whole turns are taken off
        afterwards. All others stay within their limits.
        """
        lower, upper = self.lower, self.upper
        if len(lower) <= 6:
            lower = np.where(self.turning, -np.inf, lower)
            upper = np.where(self.turning, np.inf, upper)
        positions, reached = starts.copy(), []
        for _ in range(_ITERATIONS):
            twists, jacobians = self._linearised(positions, pose[np.newaxis])
            squares = np.sum(twists**2, axis=1)
            there = squares <= _POLISHED**2
            reached.append(positions[there])
            positions, twists, jacobians = positions[~there], twists[~there], jacobians[~there]
            if not len(positions):
                break
            transposed = jacobians.transpose(0, 2, 1)
            damping = (0.5 * squares[~there] + _DAMPING)[:, np.newaxis, np.newaxis]
            steps = np.linalg.solve(
                transposed @ jacobians + damping * np.eye(len(lower)),
                transposed @ twists[:, :, np.newaxis],
            )
            positions = np.clip(positions + steps[:, :, 0], lower, upper)
        return np.concatenate(reached)

    def distinct(self, positions: FloatArray) -> FloatArray:
        """Solutions ``(n, dof)`` within the limits, each once: whole turns do not tell apart."""
        turns = np.round((positions - self._middle) / TURN) * TURN
        near = positions - np.where(self.turning, turns, 0.0)
        near = near[self.within_limits(near)]
        kept: list[FloatArray] = []
        while len(near):
            kept.append(near[0])
            apart = np.abs(near - near[0])
            apart[:, self.turning] -= TURN * np.round(apart[:, self.turning] / TURN)
            near = near[np.abs(apart).max(axis=1) > _APART]
        return np.array(kept).reshape(-1, len(self.lower))

    @cached_property
    def dimensions(self) -> int:
        """In which the end effector moves, nearly everywhere."""
        positions = self.sample(20, np.random.default_rng(0))
        _, jacobians = self._linearised(positions, self.poses(positions))
        values = np.linalg.svd(jacobians, compute_uv=False)
        return int((values > _SINGULAR * values[:, :1]).sum(axis=1).max())

    def needed(self, before: FloatArray, after: FloatArray, pose: FloatArray) -> float:
        """The largest step of a joint that a pose ``(7,)`` needs [rad or m].

        By the pseudo-inverse of the Jacobian, at the joint positions ``(dof,)`` before the step or
        at those after it, where it is larger. A joint that this would take beyond a limit goes as
        far as the limit, and the others do the rest.
        """
        twist = self._linearised(before[np.newaxis], pose[np.newaxis])[0][0]
        _, jacobians = self._linearised(np.array([before, after]), pose[np.newaxis])
        return max(self._largest_motion(before, jacobian, twist) for jacobian in jacobians)

    def _largest_motion(self, start: FloatArray, jacobian: FloatArray, twist: FloatArray) -> float:
        moving, motion, largest = np.ones(len(start), dtype=bool), np.zeros_like(start), 0.0
        while moving.any():
            left = twist - jacobian[:, ~moving] @ motion[~moving]
            motion[moving] = np.linalg.pinv(jacobian[:, moving], rcond=_ROUNDING) @ left
            largest = max(largest, float(np.abs(motion).max()))
            within = np.clip(motion, self.lower - start, self.upper - start)
            if not (beyond := moving & (within != motion)).any():
                break
            motion[beyond], moving = within[beyond], moving & ~beyond
        return largest

    def continues(self, before: FloatArray, pose: FloatArray) -> bool:
        """Whether small steps lead from joint positions ``(dof,)`` to a pose within the limits."""
        start = self.poses(before[np.newaxis])[0]
        positions = before[np.newaxis]
        for point in straight_line(start, pose, _SUBSTEPS + 1)[1:]:
            found = self.refined(positions, point)
            if not len(found) or not self.within_limits(found)[0]:
                return False
            if np.abs(found - positions).max() > np.pi / _SUBSTEPS:
                return False
            positions = found
        return True

    def _linearised(
        self, positions: FloatArray, poses: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Twists ``(n, 6)`` to poses ``(n or 1, 7)``, and Jacobians ``(n, 6, dof)``."""
        count, dof = positions.shape
        axes, points = np.empty((2, dof, count, 3))
        placements = np.tile(np.eye(4), (count, 1, 1))
        for column, joint in enumerate(self.chain.joints):
            placements = placements @ joint.placement
            axes[column] = placements[:, :3, :3] @ joint.axis
            points[column] = placements[:, :3, 3]
            placements = placements @ joint.motions(positions[:, column])
        placements = placements @ self.chain.tip
        tips = placements[:, :3, 3]
        jacobians = np.zeros((count, 6, dof))
        for column, turns in enumerate(self.turning):
            if turns:
                jacobians[:, :3, column] = np.cross(axes[column], tips - points[column])
                jacobians[:, 3:, column] = axes[column]
            else:
                jacobians[:, :3, column] = axes[column]
        wanted = Rotation.from_quat(poses[:, 3:])
        turn = (wanted * Rotation.from_matrix(placements[:, :3, :3]).inv()).as_rotvec()
        return np.hstack([poses[:, :3] - tips, turn]), jacobians
