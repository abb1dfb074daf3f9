"""Inverse kinematics by a trained network, every solution verified by the forward kinematics."""

import math
import os
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from annik_core.errors import NonFiniteValue, NotUnitQuaternion
from annik_core.kernel import compiled_kernel
from annik_core.pose import FloatArray, Numbers, checked_pose
from annik_core.robots.arm_kinematics import CompiledKinematics
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import ResolvedTarget, Robot, check_joint_count
from annik_core.safety import (
    COMMAND_CHECKS,
    UNKNOWN,
    AcceptanceLimits,
    Candidate,
    CommandContext,
    IkStatus,
    Motion,
    Refusal,
)
from annik_core.solver.result import IkResult, RefinementOptions, RefinementResult

if TYPE_CHECKING:
    from annik_core.model.artifact import Model
    from annik_core.solver.refinement import Refinement


class SolverMode(Enum):
    """How a target is solved.

    ``NETWORK``: by the network alone, as in the paper. ``REFINED``: the network's solution is
    refined on the forward kinematics inside the joint box. ``AUTO``: refined for an arm, the
    network for the gantry, whose linear kinematics it learns exactly.
    """

    AUTO = "auto"
    NETWORK = "network"
    REFINED = "refined"

    def refines(self, robot: Robot) -> bool:
        """Whether solutions for this robot are refined."""
        return robot.kind == "arm" if self is SolverMode.AUTO else self is SolverMode.REFINED


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

    def refine_batch(self, starts: FloatArray, targets: FloatArray) -> list[RefinementResult]:
        """:meth:`refine` of rows ``(n, dof)`` and ``(n, 7)``, on all processors."""
        threads = len(os.sched_getaffinity(0))
        positions, *columns = self.compiled.refine_batch(starts, targets, threads)
        rows = zip(positions, *(column.tolist() for column in columns), strict=True)
        return [RefinementResult(*row) for row in rows]


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

    def __post_init__(self) -> None:
        """Load what solving needs now, not while the first target waits."""
        if self.refines:
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

    @cached_property
    def refines(self) -> bool:
        """Whether the network's solutions are refined."""
        return self.mode.refines(self.robot)

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
        """
        reference, context = None, self._alone
        if previous is not None or motion is not None:
            reference, previous_positions = self._remembered(previous)
            context = CommandContext(self.limits, previous_positions, motion)
        target = self._checked(pose, reference)
        if isinstance(target, Refusal):
            return IkResult.refused(target)
        solution = self.artifact.joint_positions_at(target[1].pose)
        return self._result(*target, solution, context)

    def solve_batch(self, poses: ArrayLike) -> list[IkResult]:
        """Results for many poses ``(n, 7)``, each on its own, as :meth:`solve` gives them.

        The network solves all of them at once, which is quicker; its solutions may differ from
        those of one pose at a time by rounding.
        """
        targets = [self._checked(pose, None) for pose in np.asarray(poses, dtype=np.float64)]
        usable = [target for target in targets if not isinstance(target, Refusal)]
        results: list[IkResult] = []
        if usable:
            solutions = self.artifact.joint_positions(np.array([seen.pose for _, seen in usable]))
            refined: list[Any] = [None] * len(usable)
            if self.refines and isinstance(self._refinement, CompiledRefinement):
                goals = np.array([target for target, _ in usable])
                refined = self._refinement.refine_batch(solutions, goals)
            results = [
                self._result(*target, solution, self._alone, found)
                for target, solution, found in zip(usable, solutions, refined, strict=True)
            ]
        solved = iter(results)
        return [
            IkResult.refused(target) if isinstance(target, Refusal) else next(solved)
            for target in targets
        ]

    @cached_property
    def _alone(self) -> CommandContext:
        """Of a target without a previous one."""
        return CommandContext(self.limits)

    @cached_property
    def _refinement(self) -> "Refinement | CompiledRefinement":
        robot = self.robot
        box, options = robot.search_box, self.refinement_options
        if isinstance(robot.forward_kinematics, CompiledKinematics):
            return CompiledRefinement(robot.forward_kinematics, box, options)
        # Not above: its linear algebra loads slowly.
        from annik_core.solver.refinement import Refinement

        return Refinement(robot.forward_kinematics, box, options)

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
        positions = np.asarray(previous, dtype=np.float64)
        check_joint_count(positions[np.newaxis], self.robot.joint_names)
        return self.robot.workspace.reference(positions), positions

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
            target,
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


def _unwrap(candidate: Candidate, previous: FloatArray | None) -> None:
    """Turn continuous joints to within half a turn of the previous command, or of their box."""
    robot, wrapped = candidate.robot, candidate.joint_positions
    if not np.isfinite(wrapped).all():
        return
    near = robot.in_box(wrapped) if previous is None else robot.unwrapped(wrapped, previous)
    if not np.array_equal(near, wrapped):
        # The residuals must be those of exactly the joint positions that are returned.
        candidate.joint_positions, candidate.known_residuals = near, UNKNOWN
