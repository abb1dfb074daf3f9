"""The search of :mod:`annik_core.solver.search` in NumPy: the reference of the compiled one."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray, rotation_matrix
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import FULL_TURN, ForwardKinematics, unwrapped
from annik_core.solver.refinement import (
    Refinement,
    damped_least_squares,
    from_singularity,
)
from annik_core.solver.result import RefinementOptions
from annik_core.solver.search import NEAR, FoundSolution, FoundSolutions

#: Of them, those nearest to a target; for one solution a few are tried first.
_NEAREST, _FEW = 192, 8
#: Examples this far from all others are tried, by their largest difference between the first and
#: the last joint [rad or m].
_APART = 0.8
#: Starts of the sequence in a batch, and batches without a new solution that end the search; the
#: same where the number of solutions says that one is missing.
_BATCH, _IDLE_BATCHES, _ODD_BATCHES = 8, 2, 16
#: Steps of Newton's method from a start, and how many may bring little.
_MOST_STEPS, _PATIENCE = 20, 6
#: Norm of the error twist at which a start has found a solution, and at which it is exact.
_FOUND, _FINE = 1e-6, 1e-9
#: A solution this little beyond a limit is moved to it, and measured there [rad or m].
_EDGE = 1e-7
#: A singularity is close within this [rad or m], and crossed by this part of its distance.
_CLOSE, _BEYOND = 1.0, 3.0
#: Part of that distance in which there is no other solution, and its bounds [rad or m].
_ALONE, _LEAST_ALONE, _MOST_ALONE = 0.25, 2e-4, 0.05
#: Parts of a straight line to follow, and their least length.
_MOST_PARTS, _LEAST_PART = 64, 1.0 / 512.0
#: A steady step is at most this long [rad or m]; its correction is at most a part of it, or small.
_LONG, _STEADY, _SMALL = 0.5, 0.5, 1e-3
#: To a near target, joints move at most so many times what the first order says, and what is
#: rounding [rad or m].
_LEAP, _ROUNDING = 1.5, 1e-4
#: Part of a joint's range next to a limit that redundant joints avoid, and how much of the motion.
_MARGIN, _AVOID, _LEAST_DAMPING = 0.1, 0.4, 1e-9
#: Samples of a joint motion that is searched for a singularity, and the determinant of the
#: Jacobian that is zero there, as a part of the largest.
_SAMPLES, _SINGULAR = 16, 1e-6
#: Close to the axis of the first joint its angle means little [scaled lengths].
_SOFT = 0.05


@dataclass(eq=False)
class _Known:
    """A solution, whether it is within the limits, and how far it is from others at least."""

    joint_positions: FloatArray
    residuals: tuple[float, float]
    allowed: bool
    to_singularity: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class PlainSearch:
    """See :class:`annik_core.solver.search.Search`.

    Attributes:
        turns: ``(dof,)``, which joints are not prismatic.
        length: that counts as much as a radian [m].
    """

    kinematics: ForwardKinematics
    limits: JointLimits
    turns: NDArray[np.bool_]
    length: float
    options: RefinementOptions
    examples: int

    def first(self, target: FloatArray, starts: FloatArray, most: int) -> FoundSolution:
        """See :meth:`annik_core.solver.search.Search.first`."""
        known: list[_Known] = []
        taken = 0
        for start in self._starts(target, starts, known, one=True):
            if taken == most:
                break
            taken += 1
            if self._descend(start, target, 0.0, known) and known[-1].allowed:
                return FoundSolution(known[-1].joint_positions, *known[-1].residuals, taken, True)
        return FoundSolution(np.zeros(len(self.turns)), 0.0, 0.0, taken, False)

    def all(
        self, target: FloatArray, starts: FloatArray, most: int, spacing: float
    ) -> FoundSolutions:
        """See :meth:`annik_core.solver.search.Search.all`."""
        known: list[_Known] = []
        taken, redundant = 0, len(self.limits.free) > 6
        for start in self._starts(target, starts, known, one=False):
            if taken == most:
                break
            taken += 1
            self._descend(start, target, spacing if redundant else 0.0, known)
        found = [solution for solution in known if solution.allowed]
        return FoundSolutions(
            np.array([solution.joint_positions for solution in found]).reshape(
                -1, len(self.turns)
            ),
            np.array([solution.residuals[0] for solution in found]),
            np.array([solution.residuals[1] for solution in found]),
            taken,
        )

    def follow(self, previous: FloatArray, target: FloatArray) -> FoundSolution:
        """See :meth:`annik_core.solver.search.Search.follow`."""
        start = self.kinematics.poses(previous[np.newaxis])[0]
        # The way in the frame of the start.
        way = self.kinematics.linearise(previous, target).twist
        positions, steps, done, part = previous, 0, 0.0, 1.0
        for _ in range(_MOST_PARTS):
            last = done + part >= 1.0
            goal = target if last else _moved(start, (done + part) * way)
            linear = self.kinematics.linearise(positions, goal)
            squared = float(linear.twist.dot(linear.twist))
            predicted = self._within.step(linear.jacobian, linear.twist, squared, positions)
            if predicted is None:
                break
            # At a singularity, what rounding leaves of an error would turn some joints far.
            reached = squared <= self.options.tolerance**2
            if reached and np.abs(predicted - positions).max() > _ROUNDING:
                predicted = positions
            predicted = self._avoiding_limits(linear.jacobian, positions, predicted)
            steps += 1
            result = self._within.search(predicted, goal, self.options.max_newton_steps)
            steps += result.newton_steps
            if result.converged and self._steady(positions, predicted, result.joint_positions):
                positions = result.joint_positions
                if last and self._leaps(previous, start, positions, target):
                    positions = previous
                    break
                if last:
                    residuals = result.position_residual, result.orientation_residual
                    return FoundSolution(positions, *residuals, steps, True)
                done, part = done + part, 2.0 * part
            else:
                part *= 0.5
                if part < _LEAST_PART:
                    break
        return FoundSolution(
            positions, *self.kinematics.residuals(positions, target), steps, False
        )

    def same_branch(self, first: FloatArray, second: FloatArray) -> bool:
        """See :meth:`annik_core.solver.search.Search.same_branch`."""
        free = self.limits.free
        if len(free) != 6:
            return True
        between = first + np.linspace(0.0, 1.0, _SAMPLES + 1)[:, np.newaxis] * (second - first)
        determinants = np.linalg.det(self.kinematics.jacobians(between)[:, :, free])
        below, above = max(0.0, -determinants.min()), max(0.0, determinants.max())
        return bool(min(below, above) <= _SINGULAR * max(below, above))

    def _avoiding_limits(
        self, jacobian: FloatArray, start: FloatArray, predicted: FloatArray
    ) -> FloatArray:
        """Redundant joints near a limit are moved away from it, the end effector apart.

        A joint that stops at its limit would make the others move at once.
        """
        free = self.limits.free
        if len(free) <= 6:
            return predicted
        low, high, at = self.limits.lower[free], self.limits.upper[free], predicted[free]
        zone = _MARGIN * np.minimum(high - low, FULL_TURN)
        away = np.maximum(0.0, 1.0 - (at - low) / zone) - np.maximum(0.0, 1.0 - (high - at) / zone)
        motion = np.abs(at - start[free]).max()
        columns = jacobian[:, free]
        back = damped_least_squares(columns, columns @ away, _LEAST_DAMPING)
        if back is None:
            return predicted
        away = away - back
        most = np.abs(away).max()
        moved = predicted.copy()
        moved[free] += _AVOID * motion * min(1.0, most) / max(most, 1e-9) * away
        return self._within.projected(moved)

    def _leaps(
        self, previous: FloatArray, start: FloatArray, found: FloatArray, target: FloatArray
    ) -> bool:
        """Whether a joint moved much further to a near target than both ends say it must."""
        position, orientation = self.kinematics.residuals(previous, target)
        if position / self.length + orientation > NEAR:
            return False
        motion = np.abs(found - previous).max()
        for at, goal in ((previous, target), (found, start)):
            linear = self.kinematics.linearise(at, goal)
            squared = float(linear.twist.dot(linear.twist))
            step = self._within.step(linear.jacobian, linear.twist, squared, at)
            needed = 0.0 if step is None else np.abs(step - at).max()
            if motion <= _LEAP * needed + _ROUNDING:
                return False
        return True

    @cached_property
    def _turning(self) -> list[int]:
        """Indices of the joints that turn and are not locked."""
        return [joint for joint in self.limits.free.tolist() if self.turns[joint]]

    @cached_property
    def _within(self) -> Refinement:
        return Refinement(self.kinematics, self.limits, self.options)

    @cached_property
    def _around(self) -> Refinement:
        """With the limits of joints that turn left out, as far as solutions are not lost."""
        limits = self.limits
        lower, upper = limits.lower.copy(), limits.upper.copy()
        for joint in self._turning:
            if len(limits.free) <= 6 or upper[joint] - lower[joint] >= FULL_TURN:
                lower[joint], upper[joint] = -math.inf, math.inf
        return Refinement(
            self.kinematics, JointLimits(limits.joint_names, lower, upper), self.options
        )

    @cached_property
    def _examples(self) -> FloatArray:
        return np.array([self._spread(index) for index in range(self.examples)])

    @cached_property
    def _stored(self) -> tuple[FloatArray, FloatArray, "_ReducedPose", cKDTree]:
        """Examples, their poses, and a tree of the poses."""
        examples = self._examples
        reduced = _ReducedPose.of(self.kinematics, self.limits, self.turns, self.length)
        poses = self.kinematics.poses(examples)
        return examples, poses, reduced, cKDTree(reduced.features(poses))

    @cached_property
    def _bases(self) -> dict[int, int]:
        """A prime number for each joint whose position a target does not find by itself."""
        bases = dict[int, int]()
        found = {0, len(self.turns) - 1} if self.turns[-1] else {0}
        for joint in sorted({*self.limits.free.tolist()} - found):
            bases[joint] = next(
                base
                for base in itertools.count(2)
                if all(base % other for other in bases.values())
            )
        return bases

    def _spread(self, index: int) -> FloatArray:
        """The points of a Halton sequence within the limits, or in the turn in their middle.

        Joints that a target finds by itself stay there.
        """
        result = self.limits.centre.copy()
        for joint, base in self._bases.items():
            digits, scale, rest = 0, 1, index + 1
            while rest:
                rest, digit = divmod(rest, base)
                digits, scale = digits * base + digit, scale * base
            width = self.limits.upper[joint] - self.limits.lower[joint]
            width = min(width, FULL_TURN) if self.turns[joint] else width
            result[joint] += (digits / scale - 0.5) * width
        return result

    def _starts(
        self, target: FloatArray, starts: FloatArray, known: list[_Known], *, one: bool
    ) -> Iterator[FloatArray]:
        """Joint positions to begin at, in order; ``known`` grows meanwhile."""
        yield from starts
        examples, poses, reduced, tree = self._stored
        features = reduced.features(target[np.newaxis])[0]

        def nearest(count: int) -> NDArray[np.int64]:
            rows: NDArray[np.int64] = tree.query(features, min(count, len(examples)))[1]
            return rows

        if one:
            for row in nearest(_FEW):
                yield reduced.aligned(examples[row], poses[row], target)
        # The first and the last joint follow from the others.
        tried: list[FloatArray] = []
        for row in nearest(_NEAREST):
            inner = examples[row, 1:-1]
            if all((np.abs(inner - other) > _APART).any() for other in tried):
                tried.append(inner)
                yield reduced.aligned(examples[row], poses[row], target)
        reflected = 0

        def beyond() -> Iterator[FloatArray]:
            nonlocal reflected
            while reflected < len(known):
                solution = known[reflected]
                reflected += 1
                if 0.0 < np.linalg.norm(solution.to_singularity) < _CLOSE:
                    yield solution.joint_positions + _BEYOND * solution.to_singularity

        yield from beyond()
        index, idle = self.examples, 0
        # With six joints, solutions come in pairs, but for those at a singularity.
        paired = len(self.limits.free) == 6
        while one or idle < (_ODD_BATCHES if paired and len(known) % 2 else _IDLE_BATCHES):
            before = len(known)
            for _ in range(_BATCH):
                start = self._spread(index)
                pose = self.kinematics.poses(start[np.newaxis])[0]
                yield reduced.aligned(start, pose, target)
                index += 1
            yield from beyond()
            idle = 0 if len(known) > before else idle + 1

    def _descend(
        self, start: FloatArray, target: FloatArray, spacing: float, known: list[_Known]
    ) -> bool:
        """Newton's method from one start; whether it ends at a solution that was not known."""

        def is_known(positions: FloatArray) -> bool:
            return any(
                self._near(positions, solution.joint_positions, max(spacing, solution.radius))
                for solution in known
            )

        positions = self._around.projected(start)
        if is_known(positions):
            return False
        last = math.inf
        for steps in range(_MOST_STEPS + 1):
            linear = self.kinematics.linearise(positions, target)
            squared = float(linear.twist.dot(linear.twist))
            # Rounding may keep it above what is fine.
            at_rest = squared < _FOUND**2 and squared > 0.25 * last
            if not squared > _FINE**2 or at_rest:
                break
            if steps == _MOST_STEPS or (steps >= _PATIENCE and squared > 0.5 * last):
                return False
            step = self._around.step(linear.jacobian, linear.twist, squared, positions)
            if step is None or is_known(step):
                return False
            positions, last = step, squared
        if not squared < _FOUND**2 or is_known(positions):
            return False
        positions = unwrapped(positions, self.limits.centre, self._turning)
        inside = self._within.projected(positions)
        allowed = bool(np.abs(inside - positions).max() <= _EDGE)
        if allowed:
            positions = inside
        to_singularity = from_singularity(
            lambda q: self.kinematics.linearise(q, target).jacobian, positions, self.limits.free
        )
        distance = float(np.linalg.norm(to_singularity))
        radius = min(max(_ALONE * distance, _LEAST_ALONE), _MOST_ALONE)
        known.append(
            _Known(
                positions,
                self.kinematics.residuals(positions, target),
                allowed,
                to_singularity,
                radius if distance > 0.0 else _MOST_ALONE,
            )
        )
        return True

    def _near(self, first: FloatArray, second: FloatArray, distance: float) -> bool:
        away = unwrapped(first - second, 0.0, self._turning)
        return bool(np.abs(away).max() <= distance)

    def _steady(self, start: FloatArray, predicted: FloatArray, end: FloatArray) -> bool:
        """Whether a step ended near its first part, which was not long."""
        motion, correction = np.abs(predicted - start).max(), np.abs(end - predicted).max()
        return bool(motion <= _LONG and correction <= _STEADY * motion + _SMALL)


@dataclass(frozen=True, eq=False)
class _ReducedPose:
    """Poses without the motions of the first and the last joint.

    Attributes:
        base: origin ``(3,)`` and rotation ``(3, 3)`` of a frame whose z axis is that of the first
            joint.
        tool: likewise of the last joint, in the frame of the end effector.
    """

    base: tuple[FloatArray, FloatArray]
    tool: tuple[FloatArray, FloatArray]
    first_turns: bool
    last_turns: bool
    length: float

    @classmethod
    def of(
        cls,
        kinematics: ForwardKinematics,
        limits: JointLimits,
        turns: NDArray[np.bool_],
        length: float,
    ) -> "_ReducedPose":
        """From the Jacobian in the middle of the limits."""
        middle = limits.centre[np.newaxis]
        pose, jacobian = kinematics.poses(middle)[0], kinematics.jacobians(middle)[0]
        rotation = rotation_matrix(pose[3:])

        def frame(joint: int) -> tuple[FloatArray, FloatArray]:
            linear, angular = jacobian[:3, joint], jacobian[3:, joint]
            axis = angular if turns[joint] else linear
            axis = axis / np.linalg.norm(axis)
            lever = np.cross(linear, angular) / max(angular.dot(angular), 1e-12)
            return pose[:3] - lever, _frame_about(axis)

        origin, axes = frame(-1)
        return cls(
            frame(0),
            (rotation.T @ (origin - pose[:3]), rotation.T @ axes),
            bool(turns[0]),
            bool(turns[-1]) and len(turns) > 1,
            length,
        )

    def features(self, poses: FloatArray) -> FloatArray:
        """``(n, m)`` of poses ``(n, 7)``, scaled: equal where only those joints differ."""
        position, rotation = self._last(poses)
        position = position / self.length
        radius = np.hypot(position[:, 0], position[:, 1])
        cosine, sine = np.ones(len(poses)), np.zeros(len(poses))
        if self.first_turns:
            soft = np.hypot(radius, _SOFT)
            cosine, sine = position[:, 0] / soft, position[:, 1] / soft
            position = np.stack([radius, position[:, 2]], axis=1)
        else:
            position = position[:, :2]
        axes = rotation[:, :, 2:] if self.last_turns else rotation
        turned = [
            cosine[:, np.newaxis] * axes[:, 0] + sine[:, np.newaxis] * axes[:, 1],
            cosine[:, np.newaxis] * axes[:, 1] - sine[:, np.newaxis] * axes[:, 0],
            axes[:, 2],
        ]
        return np.concatenate([position, *turned], axis=1)

    def aligned(
        self, joint_positions: FloatArray, pose: FloatArray, target: FloatArray
    ) -> FloatArray:
        """Joint positions at a pose, first and last joint moved for the target."""
        result = joint_positions.copy()
        positions, rotations = self._last(np.array([pose, target]))
        start, end = rotations
        if self.first_turns:
            pairs = [(positions[0] / self.length, positions[1] / self.length)]
            columns = (2,) if self.last_turns else (0, 1, 2)
            pairs += [(start[:, column], end[:, column]) for column in columns]
            cosine = sum(float(a[0] * b[0] + a[1] * b[1]) for a, b in pairs)
            sine = sum(float(a[0] * b[1] - a[1] * b[0]) for a, b in pairs)
            angle = math.atan2(sine, cosine)
            result[0] += angle
            start = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix() @ start
        else:
            result[0] += positions[1][2] - positions[0][2]
        if self.last_turns:
            relative = start.T @ end
            result[-1] += math.atan2(
                relative[1, 0] - relative[0, 1], relative[0, 0] + relative[1, 1]
            )
        return result

    def _last(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions ``(n, 3)`` and rotations ``(n, 3, 3)`` of the last joint in the first's."""
        rotations = Rotation.from_quat(poses[:, 3:]).as_matrix()
        origins = poses[:, :3] + rotations @ self.tool[0]
        origin, axes = self.base
        return (origins - origin) @ axes, axes.T @ rotations @ self.tool[1]


def _frame_about(axis: FloatArray) -> FloatArray:
    """A rotation ``(3, 3)`` whose z axis is a unit vector."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _moved(pose: FloatArray, twist: FloatArray) -> FloatArray:
    """A pose ``(7,)`` after the motion by a constant twist in its own frame."""
    linear, angular = twist[:3], twist[3:]
    angle = float(np.linalg.norm(angular))
    first, second = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
    if angle >= 1e-3:
        first = (1.0 - math.cos(angle)) / angle**2
        second = (angle - math.sin(angle)) / angle**3
    turned = np.cross(angular, linear)
    shift = linear + first * turned + second * np.cross(angular, turned)
    start = Rotation.from_quat(pose[3:])
    rotation = start * Rotation.from_rotvec(angular)
    return np.concatenate([pose[:3] + start.apply(shift), rotation.as_quat()])
