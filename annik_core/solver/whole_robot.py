"""Solutions of an arm anywhere within its joint limits, on the branch of the previous command."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from annik_core.kernel import compiled_kernel
from annik_core.pose import FloatArray
from annik_core.robots.arm_kinematics import CompiledKinematics
from annik_core.robots.robot import FULL_TURN, Robot
from annik_core.robots.task import Task
from annik_core.safety import UNKNOWN, Candidate
from annik_core.solver.result import RefinementOptions
from annik_core.solver.search import NEAR, FoundSolution, FoundSolutions, Search, SearchOptions

if TYPE_CHECKING:
    from annik_core.solver.nearest_orientation import NearestOrientation

#: Examples that starts are from; they are computed when a model is loaded, in 25 ms.
EXAMPLES = 10_000
#: Starts of the search for a pose that an arm with another task may not be able to reach.
FEW_STARTS = 100
#: A motion of the joints that is no more than this continues the previous one [rad or m].
SHORT = 0.2
#: A solution so near by all joints is no jump, whatever its branch [rad or m].
MEETING = 0.05


@dataclass(frozen=True, eq=False)
class WholeRobot:
    """Finds solutions within the joint limits of an arm."""

    robot: Robot
    refinement: RefinementOptions = RefinementOptions()
    options: SearchOptions = SearchOptions()

    def preferred(
        self, target: FloatArray, starts: FloatArray, found: FoundSolution | None = None
    ) -> Candidate:
        """The preferred solution of a target ``(7,)``, one function of the pose.

        It is the first that the search finds: from the starts ``(n, dof)``, in their order, then
        from the nearest examples. Without any, and for another task than the pose, it is the one
        with the least rotation left over. ``found``: where the search ended, if it is done.
        """
        found = found or self._search.first(target, starts, self.most_starts)
        approach = self._nearest_orientation
        if found.found:
            residuals = found.position_residual, found.orientation_residual
            return Candidate(self.robot, target, found.joint_positions, residuals)
        if approach is not None and len(approached := approach.all(target)):
            return self._approached(target, approached[0])
        return self._unsolved(target, found.effort)

    def continued(
        self,
        target: FloatArray,
        previous: FloatArray,
        starts: Callable[[], FloatArray],
        found: FoundSolution | None = None,
    ) -> Candidate:
        """The solution on the branch of the previous joint positions ``(dof,)``.

        The joints move steadily to it while the end effector moves straight to the target. Where
        they can't, and the target is far, it is the nearest solution to which a straight motion of
        the joints passes no singularity. Otherwise the branch ends. ``starts`` is called if other
        solutions are sought. ``found``: where the straight motion ended, if that is known.
        """
        found = found or self._search.follow(previous, target)
        if found.found:
            residuals = found.position_residual, found.orientation_residual
            return Candidate(self.robot, target, found.joint_positions, residuals, found.effort)
        approach = self._nearest_orientation
        if approach is not None:
            approached = approach.follow(previous, target)
            near = np.abs(approached.joint_positions - previous).max() < SHORT
            # A short motion of the joints continues what was approached before.
            if approached.found and near:
                return self._approached(target, approached.joint_positions)
        others = self._all(target, starts())
        positions = others.joint_positions
        reached = len(positions) > 0
        if approach is not None and not reached:
            if approached.found:
                return self._approached(target, approached.joint_positions)
            positions = approach.all(target)
        if not len(positions):
            return self._unsolved(target, others.starts)
        positions = self._nearest_turns(positions, previous)
        steps = self._distances(positions, previous)
        order = np.argsort(steps, kind="stable")
        # Branches meet at a singularity: whichever goes on from there without a jump.
        if reached and steps[order[0]] < MEETING:
            return Candidate(self.robot, target, positions[order[0]])
        if reached and self._is_far(previous, target):
            for row in order:
                if steps[row] < math.pi and self._search.same_branch(previous, positions[row]):
                    return Candidate(self.robot, target, positions[row])
        nearest = self._approached(target, positions[order[0]])
        if reached:
            nearest.task = Task.POSE
        if not self.options.allow_branch_change:
            position, orientation = found.position_residual, found.orientation_residual
            nearest.branch_end = (
                f"the branch of the previous command ends {1e3 * position:.4g} mm and "
                f"{math.degrees(orientation):.4g} degrees before the target, at a limit or a "
                f"singularity; the nearest solution on another branch is {steps[order[0]]:.4g} "
                "away, by the joint that moves most (allow_branch_change would command it)"
            )
        return nearest

    def every(
        self, target: FloatArray, starts: FloatArray, near: FloatArray, *, turns: bool
    ) -> list[Candidate]:
        """All solutions, those nearest to joint positions ``(dof,)`` first.

        Of each solution the turns of revolute joints that are nearest to these, or, with
        ``turns``, all that are within the limits.
        """
        found, task = self._all(target, starts), Task.POSE
        if self._nearest_orientation is not None and not len(found.joint_positions):
            task, nearest = self.task, self._nearest_orientation.all(target)
            rows = [self.robot.forward_kinematics.residuals(row, target) for row in nearest]
            distances, angles = np.array(rows).reshape(-1, 2).T
            found = FoundSolutions(nearest, distances, angles, found.starts)
        if turns:
            positions = self._all_turns(found.joint_positions)
            residuals = [UNKNOWN] * len(positions)
        else:
            positions = self._nearest_turns(found.joint_positions, near)
            # The residuals must be those of exactly the joint positions that are returned.
            moved = (positions != found.joint_positions).any(axis=1).tolist()
            known = found.position_residuals.tolist(), found.orientation_residuals.tolist()
            residuals = [
                UNKNOWN if elsewhere else (position, orientation)
                for elsewhere, position, orientation in zip(moved, *known, strict=True)
            ]
        order = np.argsort(self._distances(positions, near), kind="stable").tolist()
        return [
            Candidate(self.robot, target, positions[row], residuals[row], task=task)
            for row in order
        ]

    @cached_property
    def most_starts(self) -> int:
        """Most starts of the search for the preferred solution."""
        most = self.options.max_starts
        # What an arm with another task can reach is found soon.
        return most if self._nearest_orientation is None else min(most, FEW_STARTS)

    @property
    def compiled_search(self) -> Any:
        """The search in the kernel; None without it."""
        return getattr(self._search, "compiled", None)

    @cached_property
    def task(self) -> Task:
        """What of a target must be reached."""
        return self.options.task.of(self.robot)

    @cached_property
    def _nearest_orientation(self) -> "NearestOrientation | None":
        """What approaches a target that can't be reached; None if all of it must be."""
        if self.task is Task.POSE:
            return None
        # Not above: most arms don't need it.
        from annik_core.solver.nearest_orientation import NearestOrientation

        tolerance = self.refinement.tolerance
        return NearestOrientation(self.robot, self.task, _length(self.robot), tolerance)

    def _approached(self, target: FloatArray, positions: FloatArray) -> Candidate:
        return Candidate(self.robot, target, positions, task=self.task)

    @cached_property
    def _search(self) -> Search:
        return search_for(self.robot, self.refinement)

    def prepare(self) -> None:
        """Compute the examples now, not while the first target waits."""
        _ = self._search, self._nearest_orientation

    def _all(self, target: FloatArray, starts: FloatArray) -> FoundSolutions:
        return self._search.all(target, starts, self.options.max_starts, self.options.spacing)

    def _unsolved(self, target: FloatArray, starts: int) -> Candidate:
        reason = f"no solution within the joint limits was found from {starts} starts"
        middle = self.robot.joint_limits.centre
        return Candidate(self.robot, target, middle, converged=False, not_found=reason)

    def _turn_range(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest number of full turns that may be added ``(..., dof)``."""
        limits, turns = self.robot.joint_limits, self.robot.rotary
        least = np.ceil((limits.lower - positions) / FULL_TURN)
        most = np.floor((limits.upper - positions) / FULL_TURN)
        least, most = np.where(turns, [least, most], 0.0)
        return np.minimum(least, 0.0), np.maximum(most, 0.0)

    def _nearest_turns(self, positions: FloatArray, near: FloatArray) -> FloatArray:
        """Solutions ``(n, dof)``, in the turns nearest to joint positions ``(dof,)``."""
        wanted = np.round((near - positions) / FULL_TURN)
        nearest: FloatArray = positions + FULL_TURN * np.clip(wanted, *self._turn_range(positions))
        return nearest

    def _all_turns(self, positions: FloatArray) -> FloatArray:
        """Solutions ``(n, dof)`` in every turn of revolute joints within the limits."""
        rows = []
        for row in positions:
            least, most = self._turn_range(row)
            choices = [
                [0.0]
                if kind == "continuous"
                else [float(k) for k in range(int(low), int(high) + 1)]
                for kind, low, high in zip(self.robot.joint_types, least, most, strict=True)
            ]
            rows += [row + FULL_TURN * np.array(turns) for turns in itertools.product(*choices)]
        return np.array(rows).reshape(-1, self.robot.dof)

    def _distances(self, positions: FloatArray, near: FloatArray) -> FloatArray:
        """The largest motion of a joint to each of ``(n, dof)`` [rad or m]."""
        distances: FloatArray = np.abs(positions - near).max(axis=1, initial=0.0)
        return distances

    def _is_far(self, previous: FloatArray, target: FloatArray) -> bool:
        position, orientation = self.robot.forward_kinematics.residuals(previous, target)
        return position / _length(self.robot) + orientation > NEAR


def _length(robot: Robot) -> float:
    """What counts as much as a radian: half the reach [m]."""
    return 0.5 * float(robot.workspace.reach)  # type: ignore[attr-defined]


# A solver with other settings, of the same robot, has the same search.
@lru_cache(maxsize=1)
def search_for(robot: Robot, options: RefinementOptions) -> Search:
    """The search of an arm: in the compiled kernel if there is one."""
    kinematics, limits = robot.forward_kinematics, robot.joint_limits
    if not isinstance(kinematics, CompiledKinematics):
        return readable_search(robot, options, EXAMPLES)
    kernel = compiled_kernel()
    bounds = (limits.lower, limits.upper, options.max_newton_steps, options.tolerance)
    refinement = kernel.Refinement(kinematics.compiled, *bounds)
    return _CompiledSearch(kernel.Search(refinement, EXAMPLES, _length(robot)))


def readable_search(robot: Robot, options: RefinementOptions, examples: int) -> Search:
    """:func:`search_for` in NumPy, whether the kernel can be used or not."""
    # Not above: its linear algebra loads slowly.
    from annik_core.solver.plain_search import PlainSearch

    kinematics, limits = robot.forward_kinematics, robot.joint_limits
    return PlainSearch(kinematics, limits, robot.rotary, _length(robot), options, examples)


@dataclass(frozen=True, eq=False)
class _CompiledSearch:
    compiled: Any

    def first(self, target: FloatArray, starts: FloatArray, most: int) -> FoundSolution:
        return FoundSolution(*self.compiled.first(target, starts, most))

    def all(
        self, target: FloatArray, starts: FloatArray, most: int, spacing: float
    ) -> FoundSolutions:
        return FoundSolutions(*self.compiled.all(target, starts, most, spacing))

    def follow(self, previous: FloatArray, target: FloatArray) -> FoundSolution:
        return FoundSolution(*self.compiled.follow(previous, target))

    def same_branch(self, first: FloatArray, second: FloatArray) -> bool:
        return bool(self.compiled.same_branch(first, second))
