"""Refine a solution on the forward kinematics, in a bounded number of steps.

Each step solves min |J dq - e|^2 + (c |e|^2 + b) |dq|^2 for the error twist e in metres and
radians [Sugihara2011]_: damped far from the target, Newton's step near it. Joints that a step
would take out of the joint box stop at their bounds, and the others are solved for again. No step
is random or taken back.

A search that stops short of the target began on the wrong side of a singularity. It is repeated
from beyond the singularities nearest to its start and to its end, the nearer to the target first.

Two branches meet where the least singular value sigma of the Jacobian is zero; the right singular
vector v is the direction across. A search that began on the wrong branch ends at the singularity,
or at a limit before it, and does not cross it by itself. Not every singularity separates branches:
where two wrist axes are aligned, v only turns their joints against each other.

References:
    [Sugihara2011] T. Sugihara: Solvability-unconcerned inverse kinematics by the
    Levenberg-Marquardt method. IEEE Transactions on Robotics 27(5), 2011.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk
from scipy.linalg.lapack import dgesv, dposv

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import ForwardKinematics
from annik_core.solver.result import RefinementOptions, RefinementResult, RefinementResults

#: c, the damping for an error of 1 m or 1 rad.
_DAMPING = 0.01
#: Below this squared error [m^2 and rad^2] a Newton step is tried first: it is quicker to compute.
_NEAR = 0.01
#: It is taken if its squared length is below this [rad^2 or m^2], which excludes singularities.
_SHORT = 0.04
#: b, which keeps the system regular at a singularity.
_LEAST_DAMPING = 1e-12
#: Types of the columns of :class:`annik_core.solver.result.RefinementResults` after the first.
_COLUMNS = (np.float64, np.float64, np.int32, np.bool_)
#: Identity matrices by size.
_IDENTITY = [np.eye(size, order="F") for size in range(33)]
#: Steps before a search may count as stuck.
_PATIENCE = 3
#: A search is stuck if a step leaves more than this part of the squared error.
_STUCK = 0.5
#: Step of the finite difference of the Jacobian along v [rad or m].
_STEP = 1e-4
#: Length of the reflection, in distances to the singularity. The mirror image, at 2, may be too
#: short; from beyond it, a search still finds the solution on that branch.
_DISTANCES = 3.0
#: Greatest length of the reflection [rad or m], since the distance is a linear estimate.
_FARTHEST = 1.5
#: Derivative of sigma along v below which no singularity is in that direction [per rad or m].
_LEAST_DERIVATIVE = 1e-9
#: Joint positions that differ by no more begin the same search [rad or m].
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Refinement:
    """Refines joint positions of one robot.

    Attributes:
        box: the joint box; locked joints have equal bounds.
    """

    kinematics: ForwardKinematics
    box: JointLimits
    options: RefinementOptions = RefinementOptions()

    def refine(self, start: FloatArray, target: FloatArray) -> RefinementResult:
        """Search for joint positions that reach a target ``(7,)``, a checked pose.

        ``start`` is moved into the box first; if it is not finite, no step is taken.
        """
        begin = self.projected(start)
        result = self.search(begin, target, self.options.max_newton_steps)
        lost = math.isnan(result.position_residual)
        if lost or result.converged or result.newton_steps == self.options.max_newton_steps:
            return result
        return self._beyond_singularities(begin, target, result)

    def refine_batch(
        self, starts: FloatArray, targets: FloatArray, threads: int | None = None
    ) -> RefinementResults:
        """:meth:`refine` of rows ``(n, dof)`` and ``(n, 7)``, one after the other."""
        rows = [self.refine(*row) for row in zip(starts, targets, strict=True)]
        positions, *columns = zip(*rows, strict=True) if rows else ((),) * 5
        return RefinementResults(
            np.array(positions).reshape(starts.shape),
            *(np.array(column, kind) for column, kind in zip(columns, _COLUMNS, strict=True)),
        )

    def _beyond_singularities(
        self, begin: FloatArray, target: FloatArray, first: RefinementResult
    ) -> RefinementResult:
        """Search anew beyond the nearest singularities, with the steps that are left."""
        known = [begin, first.joint_positions]
        for positions in tuple(known):
            beyond = self.projected(
                reflected_across_singularity(
                    lambda q: self.kinematics.linearise(q, target).jacobian,
                    positions,
                    self.box.free,
                )
            )
            # Where there is no singularity it would be the same search again.
            if not any(np.abs(beyond - other).max() <= _SAME for other in known):
                known.append(beyond)
        starts = sorted(
            known[2:], key=lambda start: self.kinematics.linearise(start, target).distance
        )
        steps = first.newton_steps
        for start in starts:
            result = self.search(start, target, self.options.max_newton_steps - steps)
            steps += result.newton_steps
            if result.converged:
                return result._replace(newton_steps=steps)
        # Without convergence the first search is reported.
        return first._replace(newton_steps=steps)

    def search(self, start: FloatArray, target: FloatArray, most: int) -> RefinementResult:
        """One search, of at most so many steps, from a start in the box."""
        linearise = self.kinematics.linearise
        positions, last, steps = start, math.inf, 0
        close = self.options.tolerance**2
        while True:
            linear = linearise(positions, target)
            twist = linear.twist
            squared = float(twist.dot(twist))
            stuck = steps >= _PATIENCE and squared > _STUCK * last
            # Not '<=', so that NaN ends it too.
            if not squared > close or steps >= most or stuck:
                break
            step = self.step(linear.jacobian, twist, squared, positions)
            if step is None:
                break
            positions, last = step, squared
            steps += 1
        position, orientation = linear.residuals
        tolerance = self.options.tolerance
        converged = position <= tolerance and orientation <= tolerance
        return RefinementResult(positions, position, orientation, steps, converged)

    def step(
        self, jacobian: FloatArray, twist: FloatArray, squared: float, positions: FloatArray
    ) -> FloatArray | None:
        """Joint positions after one step, inside the box; None if it can't be computed."""
        moving = self.box.free
        some_locked = len(moving) < len(positions)
        if some_locked:
            jacobian = jacobian[:, moving]
        motion = _short_newton_step(jacobian, twist) if squared < _NEAR else None
        damping = _DAMPING * squared + _LEAST_DAMPING
        if motion is None:
            motion = damped_least_squares(jacobian, twist, damping)
        if motion is None:
            return None
        if some_locked:
            candidate = positions.copy()
            candidate[moving] += motion
        else:
            candidate = positions + motion
        if self.box.contains(candidate):
            return candidate
        return self._bounded_step(jacobian, twist, damping, positions, candidate)

    def _bounded_step(
        self,
        jacobian: FloatArray,
        twist: FloatArray,
        damping: float,
        positions: FloatArray,
        candidate: FloatArray,
    ) -> FloatArray | None:
        """The step in which joints that would leave the box stop at their bounds.

        ``candidate`` ``(dof,)`` is the step without the box, and is overwritten.
        """
        lower, upper = self.box.lower, self.box.upper
        moving, columns = self.box.free, np.arange(len(self.box.free))
        for _ in range(len(self.box.free)):
            outside = (candidate[moving] < lower[moving]) | (candidate[moving] > upper[moving])
            if not outside.any():
                break
            stopped = moving[outside]
            candidate[stopped] = np.clip(candidate[stopped], lower[stopped], upper[stopped])
            travelled = candidate[stopped] - positions[stopped]
            twist = twist - jacobian[:, columns[outside]] @ travelled
            moving, columns = moving[~outside], columns[~outside]
            if len(moving) == 0:
                break
            motion = damped_least_squares(jacobian[:, columns], twist, damping)
            if motion is None:
                return None
            candidate[moving] = positions[moving] + motion
        return candidate

    def projected(self, joint_positions: FloatArray) -> FloatArray:
        """Joint positions moved into the box."""
        projected: FloatArray = np.minimum(
            np.maximum(joint_positions, self.box.lower), self.box.upper
        )
        return projected


def _short_newton_step(jacobian: FloatArray, twist: FloatArray) -> FloatArray | None:
    """The joint motion of J dq = e; None if there is none, or it is long and needs damping."""
    if len(twist) != jacobian.shape[1]:
        return None
    _, _, motion, fault = dgesv(jacobian, twist)
    return motion if not fault and motion.dot(motion) < _SHORT else None


def damped_least_squares(
    jacobian: FloatArray, twist: FloatArray, damping: float
) -> FloatArray | None:
    """The joint motion of least |J dq - e|^2 + damping |dq|^2; None if it can't be computed."""
    transposed = jacobian.T
    # The quickest of several equivalent ways for matrices of this size.
    normal = dsyrk(1.0, transposed, damping, _IDENTITY[len(transposed)])
    _, motion, fault = dposv(normal, transposed.dot(twist), overwrite_a=1, overwrite_b=1)
    return None if fault else motion


def reflected_across_singularity(
    jacobian: Callable[[FloatArray], FloatArray],
    joint_positions: FloatArray,
    free: NDArray[np.int64],
) -> FloatArray:
    """Joint positions ``(dof,)`` beyond the nearest singularity; the same if there is none.

    Only the joints with indices in ``free`` move.
    """
    across = _DISTANCES * from_singularity(jacobian, joint_positions, free)
    length = float(np.linalg.norm(across))
    return joint_positions + min(1.0, _FARTHEST / max(length, _STEP)) * across


def from_singularity(
    jacobian: Callable[[FloatArray], FloatArray],
    joint_positions: FloatArray,
    free: NDArray[np.int64],
) -> FloatArray:
    """The joint motion ``(dof,)`` to the nearest singularity, zero if there is none.

    With sigma = u^T J v, it is about sigma / (u^T (dJ/dv) v) away along -v.
    """
    left, singular, right = np.linalg.svd(jacobian(joint_positions)[:, free], full_matrices=False)
    across = np.zeros_like(joint_positions)
    across[free] = right[-1]
    ahead, behind = (
        jacobian(joint_positions + side * _STEP * across)[:, free] for side in (1.0, -1.0)
    )
    derivative = float(left[:, -1] @ (ahead - behind) @ right[-1]) / (2.0 * _STEP)
    if abs(derivative) < _LEAST_DERIVATIVE:
        return np.zeros_like(joint_positions)
    to_singularity: FloatArray = -float(singular[-1]) / derivative * across
    return to_singularity
