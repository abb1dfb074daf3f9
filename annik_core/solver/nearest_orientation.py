"""Joint positions that reach the position of a target, its orientation as near as possible.

For arms that can't reach every pose. What a :class:`annik_core.robots.task.Task` asks for comes
first: each step reaches that, and brings the rest of the orientation as near as it can by joint
motions that leave the first alone. Joints that a step would take beyond their limits stop there.
Several searches run at a time, in NumPy.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot, unwrapped
from annik_core.robots.task import Task
from annik_core.solver.search import FoundSolution

#: Examples; of them, so many whose poses, and so many whose positions, are nearest to a target.
_EXAMPLES, _NEAREST = 4000, 8
#: Most steps of a search; it ends where no joint moves by more than this [rad or m].
_STEPS, _AT_REST = 40, 1e-6
#: Most steps at the end for that which must be reached, alone.
_LAST_STEPS = 20
#: Longest motion of a joint in a step [rad or m].
_LONGEST = 0.5
#: Damping of the orientation, and least singular value of what must be reached.
_DAMPING, _LEAST = 1e-3, 1e-4
#: Solutions this close are the same [rad or m].
_SAME = 1e-3
#: On the way to a target: longest motion of a joint in a part of it [rad or m], and least part.
_SHORT, _LEAST_PART = 0.1, 1.0 / 64.0


@dataclass(frozen=True, eq=False)
class NearestOrientation:
    """Solutions of one arm within its joint limits, for a task that is not the whole pose.

    Attributes:
        length: that counts as much as a radian [m].
        tolerance: what must be reached is reached within this [m and rad].
    """

    robot: Robot
    task: Task
    length: float
    tolerance: float

    def all(self, target: FloatArray) -> FloatArray:
        """Joint positions ``(n, dof)`` for a target ``(7,)``, least rotation left over first."""
        examples, poses = self._examples
        shifts = (poses[:, :3] - target[:3]) / self.length
        turns = 2.0 * np.arccos(np.minimum(np.abs(poses[:, 3:] @ target[3:]), 1.0))
        squares = (shifts**2).sum(axis=1)
        near = [
            np.argsort(distances, kind="stable")[:_NEAREST]
            for distances in (squares + turns**2, squares)
        ]
        ends, reached, left_over = self._searched(examples[np.concatenate(near)], target)
        # Full turns do not tell solutions apart.
        turning = np.flatnonzero(self.robot.rotary).tolist()
        kept: list[int] = []
        for row in np.argsort(left_over, kind="stable"):
            away = unwrapped(ends[kept] - ends[row], 0.0, turning)
            apart = np.abs(away).max(axis=1, initial=0.0)
            if reached[row] and (apart > _SAME).all():
                kept.append(int(row))
        return ends[kept]

    def follow(self, previous: FloatArray, target: FloatArray) -> FoundSolution:
        """The solution to which the joints move steadily from ``previous`` ``(dof,)``.

        While the target moves from the pose there. Not found: it is where that ends.
        """
        start = self.robot.forward_kinematics.poses(previous[np.newaxis])[0]
        positions, done, part, steps = previous, 0.0, 1.0, 0
        while done < 1.0 and part >= _LEAST_PART:
            goal = _between(start, target, min(1.0, done + part))
            ends, reached, _ = self._searched(positions[np.newaxis], goal)
            steps += 1
            if reached[0] and np.abs(ends[0] - positions).max() <= _SHORT:
                positions, done = ends[0], done + part
            else:
                part *= 0.5
        residuals = self.robot.forward_kinematics.residuals(positions, target)
        return FoundSolution(positions, *residuals, steps, done >= 1.0)

    @cached_property
    def _examples(self) -> tuple[FloatArray, FloatArray]:
        examples = self.robot.joint_box.sample(_EXAMPLES, np.random.default_rng(0))
        return examples, self.robot.forward_kinematics.poses(examples)

    def _searched(
        self, starts: FloatArray, target: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_], FloatArray]:
        """Where searches from ``(n, dof)`` end, which reached it, and the rotation left over."""
        limits, rows = self.robot.joint_limits, self.task.rows
        positions = np.clip(starts, limits.lower, limits.upper)
        for _ in range(_STEPS):
            errors, jacobians = self._errors(positions, target)
            before, positions = positions, self._step(positions, errors, jacobians)
            if np.abs(positions - before).max() < _AT_REST:
                break
        for _ in range(_LAST_STEPS):
            errors, jacobians = self._errors(positions, target)
            reached = (
                np.linalg.norm(errors[:, :rows] * self._scales[:rows], axis=1) <= self.tolerance
            )
            if reached.all():
                break
            positions = self._step(positions, errors[:, :rows], jacobians[:, :rows])
        return positions, reached, np.linalg.norm(errors[:, 3:], axis=1)

    def _step(
        self, positions: FloatArray, errors: FloatArray, jacobians: FloatArray
    ) -> FloatArray:
        """Joint positions ``(n, dof)`` after one step, within the limits."""
        limits, rows = self.robot.joint_limits, self.task.rows
        moving = np.broadcast_to(limits.upper > limits.lower, positions.shape).copy()
        motions = np.zeros_like(positions)
        for _ in range(positions.shape[1]):
            columns = jacobians * moving[:, np.newaxis]
            left = errors - (jacobians @ (motions * ~moving)[:, :, np.newaxis])[:, :, 0]
            wanted = _motions(columns, left, rows)
            wanted *= np.minimum(
                1.0, _LONGEST / np.maximum(np.abs(wanted).max(axis=1, keepdims=True), _LONGEST)
            )
            motions = np.where(moving, wanted, motions)
            within = np.clip(motions, limits.lower - positions, limits.upper - positions)
            stopped = moving & (within != motions)
            motions = within
            if not stopped.any():
                break
            moving &= ~stopped
        return np.clip(positions + motions, limits.lower, limits.upper)

    def _errors(self, positions: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Errors ``(n, 6)`` in the end effector's axes, and Jacobians ``(n, 6, dof)``; scaled."""
        poses = self.robot.forward_kinematics.poses(positions)
        axes = _rotations(poses[:, 3:]).swapaxes(1, 2)
        shift = (axes @ (target[:3] - poses[:, :3])[:, :, np.newaxis])[:, :, 0]
        turn = _relative(poses[:, 3:], target[3:])
        rotation = _swing_and_twist(turn) if self.task is Task.POSITION_AND_AXIS else _vector(turn)
        jacobians = self.robot.forward_kinematics.jacobians(positions)
        jacobians = np.concatenate([axes @ jacobians[:, :3], axes @ jacobians[:, 3:]], axis=1)
        scales = self._scales
        return np.concatenate([shift, rotation], axis=1) / scales, jacobians / scales[
            :, np.newaxis
        ]

    @cached_property
    def _scales(self) -> FloatArray:
        return np.array([self.length] * 3 + [1.0] * 3)


def _motions(jacobians: FloatArray, errors: FloatArray, rows: int) -> FloatArray:
    """Joint motions ``(n, dof)``: the first rows come first, the others as far as these allow."""
    inverses = np.linalg.pinv(jacobians[:, :rows], rcond=_LEAST)
    motions: FloatArray = inverses @ errors[:, :rows, np.newaxis]
    if errors.shape[1] > rows:
        rest = jacobians[:, rows:]
        alone = np.eye(jacobians.shape[2]) - inverses @ jacobians[:, :rows]
        moved = rest @ alone
        left = errors[:, rows:, np.newaxis] - rest @ motions
        transposed = moved.swapaxes(1, 2)
        normal = transposed @ moved + _DAMPING * np.eye(jacobians.shape[2])
        motions = motions + alone @ np.linalg.solve(normal, transposed @ left)
    return motions[:, :, 0]


def _rotations(quaternions: FloatArray) -> FloatArray:
    """Matrices ``(n, 3, 3)`` of unit quaternions ``(n, 4)``."""
    x, y, z, w = quaternions.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _relative(quaternions: FloatArray, target: FloatArray) -> FloatArray:
    """Rotations to a target ``(4,)`` in the axes of ``(n, 4)``, with w >= 0."""
    vectors, w = quaternions[:, :3], quaternions[:, 3:]
    vector = w * target[:3] - target[3] * vectors - np.cross(vectors, target[:3])
    real = w * target[3] + vectors @ target[:3, np.newaxis]
    turn = np.concatenate([vector, real], axis=1)
    return np.where(real < 0.0, -turn, turn)


def _vector(turn: FloatArray) -> FloatArray:
    """Rotation vectors ``(n, 3)`` of quaternions ``(n, 4)`` with w >= 0."""
    sines = np.linalg.norm(turn[:, :3], axis=1, keepdims=True)
    angles = 2.0 * np.arctan2(sines, turn[:, 3:])
    return turn[:, :3] * np.where(sines > 0.0, angles / np.maximum(sines, 1e-300), 2.0)


def _swing_and_twist(turn: FloatArray) -> FloatArray:
    """Rotation vectors, x and y, that bring the z axis there, and the angle about it before."""
    x, y, z, w = turn.T
    real = np.hypot(w, z)
    safe = np.maximum(real, 1e-12)
    swing = np.stack([(w * x - y * z) / safe, (w * y + x * z) / safe, 0.0 * x, real], axis=1)
    vector = _vector(swing)
    vector[:, 2] = 2.0 * np.arctan2(z, w)
    return vector


def _between(start: FloatArray, end: FloatArray, part: float) -> FloatArray:
    """The pose ``(7,)`` at a part of the way between two; they turn about one axis."""
    if part >= 1.0:
        return end
    cosine = float(start[3:] @ end[3:])
    last = end[3:] if cosine >= 0.0 else -end[3:]
    angle = math.acos(min(abs(cosine), 1.0))
    if angle < 1e-6:
        quaternion = start[3:] + part * (last - start[3:])
    else:
        quaternion = (
            math.sin((1.0 - part) * angle) * start[3:] + math.sin(part * angle) * last
        ) / math.sin(angle)
    position = start[:3] + part * (end[:3] - start[:3])
    return np.concatenate([position, quaternion / np.linalg.norm(quaternion)])
