"""Inverse kinematics by a trained network, every solution verified by the forward kinematics."""

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from annik_core.errors import InvalidValue, NonFiniteValue, NotUnitQuaternion
from annik_core.kernel import compiled_kernel
from annik_core.pose import (
    ACCURATE_PITCH,
    CERTAIN_NORM,
    FloatArray,
    Numbers,
    checked_pose,
    normalise_rows,
)
from annik_core.robots.arm import ArmWorkspace
from annik_core.robots.arm_kinematics import CompiledKinematics
from annik_core.robots.gantry import GantryWorkspace
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import NO_REFERENCE, ResolvedTarget, Robot, check_joint_count
from annik_core.robots.task import Task
from annik_core.safety import (
    COMMAND_CHECKS,
    MOTION_CHECKS,
    UNKNOWN,
    AcceptanceLimits,
    Candidate,
    CommandContext,
    IkStatus,
    Motion,
    Refusal,
    surely_accepted,
)
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import (
    IkResult,
    IkResults,
    RefinementOptions,
    RefinementResult,
    RefinementResults,
)
from annik_core.solver.search import FoundSolution, SearchOptions
from annik_core.solver.whole_robot import WholeRobot

if TYPE_CHECKING:
    from annik_core.model.artifact import Model
    from annik_core.model.session import BoundSession
    from annik_core.solver.refinement import Refinement

#: Poses in a call of the network: as many as leave its activations in a processor's cache.
_PART = 256


@dataclass(frozen=True, eq=False)
class CompiledRefinement:
    """:class:`annik_core.solver.refinement.Refinement` in the compiled kernel, for any thread."""

    kinematics: CompiledKinematics
    box: JointLimits
    options: RefinementOptions = RefinementOptions()

    @cached_property
    def compiled(self) -> Any:
        """The object in the kernel."""
        bounds, most = (self.box.lower, self.box.upper), self.options.max_newton_steps
        chain = self.kinematics.compiled
        return compiled_kernel().Refinement(chain, *bounds, most, self.options.tolerance)

    def refine(self, start: FloatArray, target: FloatArray) -> RefinementResult:
        """Search for joint positions that reach a target ``(7,)``, as the other does."""
        return RefinementResult(*self.compiled.refine(start, target))

    def refine_batch(
        self, starts: FloatArray, targets: FloatArray, threads: int | None = None
    ) -> RefinementResults:
        """:meth:`refine` of rows ``(n, dof)`` and ``(n, 7)``, on some threads; None: all cores."""
        threads = threads or usable_cores()
        return RefinementResults(*self.compiled.refine_batch(starts, targets, threads))


def usable_cores() -> int:
    """How many processor cores this process may use."""
    return len(os.sched_getaffinity(0))


def refinement_of(
    robot: Robot, options: RefinementOptions | None = None
) -> "Refinement | CompiledRefinement":
    """The refinement of a robot's solutions, compiled where it can be."""
    kinematics, options = robot.forward_kinematics, options or RefinementOptions()
    if isinstance(kinematics, CompiledKinematics):
        return CompiledRefinement(kinematics, robot.search_box, options)
    # Not above: its linear algebra loads slowly.
    from annik_core.solver.refinement import Refinement

    return Refinement(kinematics, robot.search_box, options)


@dataclass(frozen=True, eq=False)
class IkSolver:
    """Turns target poses into joint positions, in a bounded number of operations.

    A target is checked first (finite numbers, unit quaternion, workspace), then its solution, by
    :data:`annik_core.safety.COMMAND_CHECKS`. These see exactly the joint positions that are
    returned; nothing is clamped. The first check that fails makes the result a refusal.

    Attributes:
        seed_from_previous: in refined mode, begin at the previous solution where its pose is
            nearer to the target than the network's. Then a solution depends on those before it.
    """

    artifact: "Model"
    limits: AcceptanceLimits = AcceptanceLimits()
    mode: SolverMode = SolverMode.AUTO
    refinement_options: RefinementOptions = RefinementOptions()
    seed_from_previous: bool = False
    search_options: SearchOptions = SearchOptions()

    def __post_init__(self) -> None:
        """Load what solving needs now, not while the first target waits."""
        if self.whole_robot is not None:
            self.whole_robot.prepare()
        elif self.refines:
            _ = self._refinement

    @classmethod
    def from_file(
        cls, name_or_path: str | Path, limits: AcceptanceLimits | None = None
    ) -> "IkSolver":
        """The solver for a packaged model, by its name, or for a model file.

        Raises:
            ModelError: if the file can't be used; see :mod:`annik_core.model.errors`.
        """
        # Not above: a node joins the others before it loads what reads model files.
        from annik_core.model.artifact import load_model

        return cls(load_model(name_or_path), limits or AcceptanceLimits())

    @property
    def robot(self) -> Robot:
        """The robot that the model was trained for."""
        return self.artifact.robot

    @property
    def chosen_mode(self) -> SolverMode:
        """The mode, with ``AUTO`` decided."""
        return self.mode.of(self.robot)

    @cached_property
    def refines(self) -> bool:
        """Whether the network's solutions are refined."""
        return self.mode.refines(self.robot)

    @property
    def task(self) -> Task:
        """What of a target must be reached; the orientation as near as possible besides."""
        return Task.POSE if self.whole_robot is None else self.whole_robot.task

    @cached_property
    def whole_robot(self) -> WholeRobot | None:
        """What finds solutions within the joint limits; None if they are sought in the box."""
        if self.chosen_mode is not SolverMode.WHOLE_ROBOT:
            return None
        if self.robot.kind != "arm":
            raise InvalidValue("mode", self.mode.value, "another: only an arm is searched whole")
        return WholeRobot(self.robot, self.refinement_options, self.search_options)

    def solve(
        self,
        pose: ArrayLike,
        previous: IkResult | ArrayLike | None = None,
        motion: Motion | None = None,
    ) -> IkResult:
        """Joint positions that reach one pose, or a refusal; a bad target never raises.

        Args:
            pose: seven numbers in the robot's base frame: x, y, z [m], unit quaternion x, y, z, w.
            previous: the accepted result for the target before, or, at first, the joint positions
                ``(dof,)`` [rad or m] where the robot is. The joint step is measured from it, and
                where the pose leaves a choice the solution stays close to it. Continuous joints
                are within half a turn of it; without it, of the middle of their box.
            motion: the motion of a running robot that this continues, if its checks are to run
                too, as :class:`annik_core.serving.ik_server.IkServer` has them do.

        Raises:
            WrongShape: if ``pose`` is not seven numbers, or ``previous`` not one per joint.
            NonFiniteValue: if one of ``previous`` is NaN or infinite.
        """
        reference, context = None, self._alone
        if previous is not None or motion is not None:
            reference, previous_positions = self._remembered(previous)
            context = CommandContext(self.limits, previous_positions, motion)
        whole = self.whole_robot
        if whole is None:
            result = self._certain_result(pose, context)
        else:
            result = self._found_in_kernel(whole, pose, context)
        if result is not None:
            return result
        target = self._checked(pose, reference)
        if isinstance(target, Refusal):
            return IkResult.refused(target)
        if whole is not None:
            return self._whole_result(whole, target[0], context)
        solution = self.artifact.joint_positions_at(target[1].pose)
        return self._result(*target, solution, context)

    def solutions(
        self, pose: ArrayLike, near: ArrayLike | None = None, *, turns: bool = False
    ) -> list[IkResult]:
        """All joint positions that reach one pose, nearest first; empty if there is none.

        Within the joint limits of a whole robot, otherwise the one solution in the joint box. Each
        is checked as :meth:`solve` does without a previous one. Of an arm with more than six
        joints, which has infinitely many, they are ``search_options.spacing`` apart.

        Args:
            pose: as in :meth:`solve`.
            near: joint positions ``(dof,)`` [rad or m] to which near is nearest, by the joint that
                moves most; by default the middle of the joint limits.
            turns: list every solution in all full turns that the limits allow, not only in the
                nearest one.

        Raises:
            WrongShape: as :meth:`solve`, of ``near`` too.
            NonFiniteValue: if one of ``near`` is NaN or infinite.
        """
        near = self._known_positions(self.robot.joint_limits.centre if near is None else near)
        every = None if turns else self._all_in_kernel(pose, near)
        if every is not None:
            return every
        target = self._checked(pose, self.robot.workspace.reference(near))
        if isinstance(target, Refusal):
            return []
        if self.whole_robot is None:
            results = [self.solve(pose, near)]
        else:
            starts = self._network_starts(target[0])
            found = self.whole_robot.every(target[0], starts, near, turns=turns)
            results = [self._checked_result(one, target[1], self._alone) for one in found]
        return [result for result in results if result.accepted]

    def _network_starts(self, target: FloatArray) -> FloatArray:
        """The network's joint positions ``(n, dof)`` that are finite, refined in a box before."""
        starts = self.artifact.start_at(target)[np.newaxis]
        starts = starts[np.isfinite(starts).all(axis=1)]
        if not len(starts) or self.robot.has_whole_box:
            return starts
        # The solution in the joint box, where there is one, is the preferred one.
        return np.concatenate([[self._refinement.refine(starts[0], target)[0]], starts])

    def solve_batch(self, poses: ArrayLike, threads: int | None = None) -> Sequence[IkResult]:
        """Results for many poses ``(n, 7)``, each on its own, as :meth:`solve` gives them.

        All poses go through network, refinement and checks together, which is quicker, on some
        threads, by default as many as there are cores for this process. The solutions may differ
        from those of one pose at a time by rounding. A pose that does not pass every check in this
        way is checked by itself, so a refusal and its reason are those of :meth:`solve`.

        Returns:
            A list, or, where solutions are refined, :class:`annik_core.solver.result.IkResults`,
            which has the joint positions as an array too.
        """
        targets = np.array(poses, dtype=np.float64)
        if self.whole_robot is not None or targets.ndim != 2 or targets.shape[1] != 7:
            return [self.solve(pose) for pose in targets]
        threads = threads or usable_cores()
        others: dict[int, IkResult] = {}
        usable = normalise_rows(targets) & self.robot.workspace.plainly_inside(targets)
        shown, resolved = targets.copy(), dict[int, ResolvedTarget]()
        for row in np.flatnonzero(~usable).tolist():
            checked = self._checked(targets[row], None)
            if isinstance(checked, Refusal):
                others[row] = IkResult.refused(checked)
                # Another pose in its place, so that all rows can be computed.
                targets[row] = shown[row] = self._some_pose
                continue
            targets[row], resolved[row] = checked
            shown[row] = resolved[row].pose
        solutions = self._network(shown, threads)
        if not self.refines:
            rows = range(len(targets))
            alone = (resolved.get(row) or _as_it_is(targets[row]) for row in rows)
            return [
                others.get(row) or self._result(targets[row], target, solutions[row], self._alone)
                for row, target in zip(rows, alone, strict=True)
            ]
        refined = self._refinement.refine_batch(solutions, targets, threads)
        accepted, errors = self._accepted(solutions, refined)
        for row in {*np.flatnonzero(~accepted).tolist(), *resolved} - {*others}:
            target = resolved.get(row) or _as_it_is(targets[row])
            one = refined.row(row)
            others[row] = self._result(targets[row], target, solutions[row], self._alone, one)
        return IkResults(targets, refined, errors, others)

    @cached_property
    def _some_pose(self) -> FloatArray:
        """A pose ``(7,)`` inside the workspace."""
        pose: FloatArray = self.robot.forward_kinematics.poses(self.robot.joint_box.centre[None])[
            0
        ]
        return pose

    @cached_property
    def _solved_in_kernel(self) -> Callable[[ArrayLike], Any] | None:
        """Target, reference and solution of one pose in the kernel; None if it can't be had there.

        What the kernel is not certain of gives None too.
        """
        if self.limits.limits_expected_errors:
            return None
        if isinstance(self.robot.workspace, GantryWorkspace):
            return self._gantry_in_kernel(self.robot.workspace)
        bound, network = self._bound_arm, self._arm_network
        if bound is None or network is None or self.robot.turning or self.seed_from_previous:
            return None
        if self.artifact.start_network is not None:
            return partial(bound.solve, self.artifact.start_network)
        return self._around_network(bound, network)

    @property
    def _arm_network(self) -> "BoundSession | None":
        return self.artifact.after_encoding("position_rotation_matrix")

    @cached_property
    def _bound_arm(self) -> Any:
        """An arm's network, refinement and checks in the kernel; None if they are not there."""
        robot, limits, workspace = self.robot, self.limits, self.robot.workspace
        network = self._arm_network
        if not self.refines or not isinstance(self._refinement, CompiledRefinement):
            return None
        if network is None or not isinstance(workspace, ArmWorkspace):
            return None
        return compiled_kernel().BoundSolve(
            *(self._refinement.compiled, network.input_row, network.output_row),
            *(workspace.centre, workspace.certain_reach),
            *(robot.joint_limits.lower, robot.joint_limits.upper),
            *(limits.max_position_residual, limits.max_orientation_residual),
            CERTAIN_NORM,
        )

    @cached_property
    def _whole_in_kernel(self) -> tuple[Callable[..., Any], Callable[..., Any]] | None:
        """Searches of a whole robot in the kernel: for one solution, and for all of them."""
        whole, bound, options = self.whole_robot, self._bound_arm, self.search_options
        if whole is None or bound is None or self.limits.limits_expected_errors:
            return None
        search, network = whole.compiled_search, self.artifact.start_network
        if search is None or network is None:
            return None
        begin = search, network, not self.robot.has_whole_box
        return (
            partial(bound.find, *begin, whole.most_starts),
            partial(bound.find_all, *begin, options.max_starts, options.spacing),
        )

    def _found_in_kernel(
        self, whole: WholeRobot, pose: ArrayLike, context: CommandContext
    ) -> IkResult | None:
        """The result of a whole robot, if the kernel is certain of the target; otherwise None."""
        if self._whole_in_kernel is None:
            return None
        solved = self._whole_in_kernel[0](pose, context.previous)
        if solved is None:
            return None
        target, reference, found, certain = solved
        if not certain:
            return self._whole_result(whole, target, context, FoundSolution(*found))
        positions, distance, angle, effort, _ = found
        steps = 0 if context.previous is None else effort
        return self._in_motion(target, reference, (positions, distance, angle, steps), context)

    def _all_in_kernel(self, pose: ArrayLike, near: FloatArray) -> list[IkResult] | None:
        """All solutions of a whole robot, if the kernel is certain of them; otherwise None."""
        solved = self._whole_in_kernel and self._whole_in_kernel[1](pose, near)
        if not solved:
            return None
        target, reference, found = solved
        # Without any, an arm with another task approaches the target.
        if not found and self.task is not Task.POSE:
            return None
        return [self._accepted_result(target, reference, (*one, 0)) for one in found]

    def _whole_result(
        self,
        whole: WholeRobot,
        target: FloatArray,
        context: CommandContext,
        found: FoundSolution | None = None,
    ) -> IkResult:
        """The result of a whole robot; ``found``: where its first search ended, if it is done."""
        starts = partial(self._network_starts, target)
        if context.previous is None:
            candidate = whole.preferred(target, starts(), found)
        else:
            candidate = whole.continued(target, context.previous, starts, found)
        return self._checked_result(candidate, _as_it_is(target), context)

    def _gantry_in_kernel(self, workspace: GantryWorkspace) -> Callable[[ArrayLike], Any] | None:
        robot, limits, kernel = self.robot, self.limits, compiled_kernel()
        network = self.artifact.after_encoding("position_roll_pitch_yaw")
        if network is None or self.refines or robot.turning or kernel is None:
            return None
        inside = workspace.certainly_inside.copy()
        inside[:, 4] = inside[:, 4].clip(-ACCURATE_PITCH, ACCURATE_PITCH)
        bound = kernel.BoundGantry(
            *(network.input_row, network.output_row),
            *(workspace.kinematics.ratio, workspace.kinematics.offset, inside),
            np.array([robot.joint_limits.lower, robot.joint_limits.upper]),
            *(limits.max_position_residual, limits.max_orientation_residual),
            CERTAIN_NORM,
        )
        return self._around_network(bound, network)

    def _around_network(self, bound: Any, network: "BoundSession") -> Callable[[ArrayLike], Any]:
        """The same, the network's output computed by onnxruntime."""

        def solve(pose: ArrayLike) -> Any:
            prepared = bound.prepare(pose)
            if prepared is None:
                return None
            self.artifact.run(network)
            found = bound.finish(prepared[0])
            return None if found is None else (*prepared, found)

        return solve

    def _certain_result(self, pose: ArrayLike, context: CommandContext) -> IkResult | None:
        """The result, if the kernel is certain of target and solution; otherwise None.

        What it is not certain of may be refused, and :meth:`solve` goes on to say why.
        """
        solve = self._solved_in_kernel
        solved = None if solve is None else solve(pose)
        if solved is None:
            return None
        target, reference, solution = solved
        return self._in_motion(target, reference, solution, context)

    def _in_motion(
        self,
        target: FloatArray,
        reference: Numbers,
        solution: tuple[FloatArray, float, float, int],
        context: CommandContext,
    ) -> IkResult:
        """The result for a solution that passes every check but perhaps those of the motion."""
        if context is not self._alone:
            positions, distance, angle, steps = solution
            candidate = Candidate(self.robot, target, positions, (distance, angle), steps)
            for check in MOTION_CHECKS:
                refusal = check(candidate, context)
                if refusal is not None:
                    return IkResult.refused(refusal, (distance, angle), steps)
        return self._accepted_result(target, reference, solution)

    def _accepted_result(
        self,
        target: FloatArray,
        reference: Numbers,
        solution: tuple[FloatArray, float, float, int],
    ) -> IkResult:
        """The result for joint positions, residuals and steps that no check refuses."""
        bound = self.robot.error_bound
        expected = UNKNOWN if bound is None else bound.at(self.robot.in_box(solution[0]))
        return IkResult(IkStatus.SUCCESS, *solution, "", target, reference, *expected)

    def _network(self, poses: FloatArray, threads: int) -> FloatArray:
        """The network's joint positions ``(n, dof)``."""
        parts = [poses[begin : begin + _PART] for begin in range(0, len(poses), _PART)]
        if len(parts) < 2:
            return self.artifact.joint_positions(poses)
        if threads == 1:
            return np.concatenate(list(map(self.artifact.joint_positions, parts)))
        # onnxruntime works without Python's lock.
        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(self.artifact.joint_positions, parts)))

    def _accepted(
        self, solutions: FloatArray, refined: RefinementResults
    ) -> tuple[NDArray[np.bool_], FloatArray]:
        """Rows that no check refuses for certain ``(n,)``, and expected errors ``(n, 2)``."""
        robot, positions = self.robot, refined.joint_positions
        residuals = np.column_stack([refined.position_residual, refined.orientation_residual])
        errors = np.full((len(positions), 2), math.nan)
        with np.errstate(invalid="ignore"):
            near = robot.in_box(positions)
            if robot.error_bound is not None:
                errors = robot.error_bound.of_rows(near)
        good = surely_accepted(robot, self.limits, positions, residuals, refined.converged, errors)
        good &= np.isfinite(solutions).all(axis=1) & (near == positions).all(axis=1)
        return good, errors

    @cached_property
    def _alone(self) -> CommandContext:
        """Of a target without a previous one."""
        return CommandContext(self.limits)

    @cached_property
    def _refinement(self) -> "Refinement | CompiledRefinement":
        return refinement_of(self.robot, self.refinement_options)

    def _checked(
        self, pose: ArrayLike, reference: Numbers | None
    ) -> tuple[FloatArray, ResolvedTarget] | Refusal:
        """The checked target ``(7,)``, and as the network should see it."""
        try:
            target = checked_pose(pose)
        except NonFiniteValue as error:
            return Refusal(IkStatus.NOT_FINITE, str(error))
        except NotUnitQuaternion as error:
            return Refusal(IkStatus.NOT_UNIT_QUATERNION, str(error))
        resolved = self.robot.workspace.resolve(target, reference)
        if resolved.violation is not None:
            return Refusal(IkStatus.OUTSIDE_WORKSPACE, resolved.violation)
        return target, resolved

    def _remembered(
        self, previous: IkResult | ArrayLike | None
    ) -> tuple[Numbers | None, FloatArray | None]:
        """Reference and joint positions of what came before."""
        if previous is None:
            return None, None
        if isinstance(previous, IkResult):
            return previous.reference, previous.joint_positions
        positions = self._known_positions(previous)
        return self.robot.workspace.reference(positions), positions

    def _known_positions(self, given: ArrayLike) -> FloatArray:
        """Joint positions ``(dof,)`` of a caller, as numbers."""
        positions, names = np.asarray(given, dtype=np.float64), self.robot.joint_names
        check_joint_count(positions[np.newaxis], names)
        for name, position in zip(names, positions.tolist(), strict=True):
            if not math.isfinite(position):
                raise NonFiniteValue(f"position of {name}", position)
        return positions

    def _result(
        self,
        target: FloatArray,
        resolved: ResolvedTarget,
        network_solution: FloatArray,
        context: CommandContext,
        refined: RefinementResult | None = None,
    ) -> IkResult:
        """The network's solution, refined if asked and not done before, checked."""
        candidate = self._candidate(target, network_solution, context.previous, refined)
        return self._checked_result(candidate, resolved, context)

    def _checked_result(
        self, candidate: Candidate, resolved: ResolvedTarget, context: CommandContext
    ) -> IkResult:
        """The result for a candidate: a refusal if one of the checks refuses it."""
        for check in COMMAND_CHECKS:
            refusal = check(candidate, context)
            if refusal is not None:
                return IkResult.refused(refusal, candidate.known_residuals, candidate.newton_steps)
        candidate.joint_positions.setflags(write=False)
        return IkResult(
            IkStatus.SUCCESS,
            candidate.joint_positions,
            *candidate.residuals(),
            candidate.newton_steps,
            "",
            candidate.target,
            resolved.reference,
            *candidate.expected_errors(),
        )

    def _candidate(
        self,
        target: FloatArray,
        network_solution: FloatArray,
        previous: FloatArray | None,
        refined: RefinementResult | None,
    ) -> Candidate:
        robot = self.robot
        # What is not finite is not refined: such a network is broken.
        if not self.refines or not all(map(math.isfinite, network_solution.tolist())):
            candidate = Candidate(robot, target, network_solution)
        else:
            start = network_solution
            if self.seed_from_previous and previous is not None:
                start = min(
                    (network_solution, robot.in_box(previous)),
                    key=lambda q: robot.forward_kinematics.linearise(q, target).distance,
                )
            found = refined or self._refinement.refine(start, target)
            candidate = Candidate(
                robot,
                target,
                found.joint_positions,
                (found.position_residual, found.orientation_residual),
                found.newton_steps,
                found.converged,
            )
        if robot.turning:
            _unwrap(candidate, previous)
        return candidate


def _as_it_is(target: FloatArray) -> ResolvedTarget:
    """A target that leaves no choice."""
    return ResolvedTarget(target, None, NO_REFERENCE)


def _unwrap(candidate: Candidate, previous: FloatArray | None) -> None:
    """Turn continuous joints to within half a turn of the previous command, or of their box."""
    robot, wrapped = candidate.robot, candidate.joint_positions
    if not np.isfinite(wrapped).all():
        return
    near = robot.in_box(wrapped) if previous is None else robot.unwrapped(wrapped, previous)
    if not np.array_equal(near, wrapped):
        # The residuals must be those of exactly the joint positions that are returned.
        candidate.joint_positions, candidate.known_residuals = near, UNKNOWN
