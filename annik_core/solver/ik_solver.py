"""Inverse kinematics by a trained network, every answer verified by the forward kinematics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from annik_core.errors import NonFiniteValue, NotUnitQuaternion
from annik_core.pose import FloatArray, Numbers, checked_pose
from annik_core.robots.robot import ResolvedTarget, Robot
from annik_core.safety import (
    AcceptanceLimits,
    expected_error_violation,
    joint_step_violation,
    residual_violation,
)
from annik_core.solver.options import Refined, RefinementOptions
from annik_core.solver.result import IkResult, IkStatus

if TYPE_CHECKING:
    from annik_core.model.artifact import Model
    from annik_core.solver.refinement import Refinement


class SolverMode(Enum):
    """What answers a target.

    ``NETWORK``: the network alone, as in the paper. ``REFINED``: the network's answer, polished on
    the forward kinematics inside the working joint box. ``AUTO``: refined for an arm, the network
    for the gantry, whose linear kinematics it learns exactly.
    """

    AUTO = "auto"
    NETWORK = "network"
    REFINED = "refined"

    def refines(self, robot: Robot) -> bool:
        """Whether answers for this robot are polished."""
        return robot.kind == "arm" if self is SolverMode.AUTO else self is SolverMode.REFINED


@dataclass(frozen=True, eq=False)
class IkSolver:
    """Turns target poses into joint positions, in a bounded number of operations.

    The checks run in this order, and the first that fails is the answer: finite numbers, unit
    quaternion, workspace, network, convergence (refined mode), joint limits, residual, expected
    error (of a robot learned from measured poses), joint step.
    They see exactly the joint positions that are returned; nothing is clamped.

    Attributes:
        artifact: the trained network and the robot that it is for.
        limits: what an answer must satisfy.
        mode: what answers a target.
        refinement_options: how far an answer is polished in refined mode.
        seed_from_previous: in refined mode, begin at the previous answer where its pose is nearer
            to the target than the network's. Then an answer depends on what came before it.
    """

    artifact: Model
    limits: AcceptanceLimits = AcceptanceLimits()
    mode: SolverMode = SolverMode.AUTO
    refinement_options: RefinementOptions = RefinementOptions()
    seed_from_previous: bool = False

    def __post_init__(self) -> None:
        """Load what answers need now, not while the first target waits."""
        if self.refines:
            _ = self._refinement

    @classmethod
    def from_file(cls, path: str | Path, limits: AcceptanceLimits | None = None) -> IkSolver:
        """The solver for a model file.

        Raises:
            ArtifactError: if the file can't be used; see :mod:`annik_core.errors`.
        """
        # Not above: a node joins the others before it loads what reads model files.
        from annik_core.model.artifact import load_model

        return cls(load_model(path), limits or AcceptanceLimits())

    @property
    def robot(self) -> Robot:
        """The robot that the model was trained for."""
        return self.artifact.robot

    @cached_property
    def refines(self) -> bool:
        """Whether the network's answers are polished."""
        return self.mode.refines(self.robot)

    def solve(self, pose: ArrayLike, previous: IkResult | FloatArray | None = None) -> IkResult:
        """Joint positions that reach one pose.

        Args:
            pose: ``(7,)`` x, y, z [m], unit quaternion x, y, z, w, in the robot's base frame.
            previous: the accepted answer to the target before, or, at first, the joint positions
                ``(dof,)`` [rad or m] where the robot is. The joint step is measured from it, and
                where the pose leaves a choice the answer stays close to it.

        Returns:
            The answer or the refusal. Never raises for a bad target of seven numbers.

        Raises:
            WrongShape: if ``pose`` is not seven numbers.
        """
        reference, previous_positions = self._remembered(previous)
        checked = self._checked(pose, reference)
        if isinstance(checked, IkResult):
            return checked
        resolved = checked.resolved
        answer = self.artifact.joint_positions_at(resolved.pose, resolved.roll_pitch_yaw)
        return self._result(checked, answer, previous_positions)

    def solve_batch(self, poses: ArrayLike) -> list[IkResult]:
        """Answers to many poses ``(n, 7)``, each on its own, as :meth:`solve` gives them.

        The network answers all of them at once, which is quicker; its answers may differ from
        those to one pose at a time by rounding.
        """
        checked = [self._checked(pose, None) for pose in np.asarray(poses, dtype=np.float64)]
        targets = [target for target in checked if isinstance(target, _Target)]
        if not targets:
            return [target for target in checked if isinstance(target, IkResult)]
        answers = iter(
            self.artifact.joint_positions(np.array([target.resolved.pose for target in targets]))
        )
        return [
            target if isinstance(target, IkResult) else self._result(target, next(answers), None)
            for target in checked
        ]

    @cached_property
    def _judges_expected_error(self) -> bool:
        limits = self.limits.max_expected_error, self.limits.max_expected_orientation_error
        return self.robot.error_bound is not None or not all(map(math.isinf, limits))

    @cached_property
    def _refinement(self) -> Refinement:
        # Loaded for those who refine only: the linear algebra behind it takes a while.
        from annik_core.solver.refinement import Refinement

        robot = self.robot
        return Refinement(robot.forward_kinematics, robot.joint_box, self.refinement_options)

    def _checked(self, pose: ArrayLike, reference: Numbers | None) -> _Target | IkResult:
        try:
            target = checked_pose(pose)
        except NonFiniteValue as error:
            return IkResult.refused(IkStatus.NOT_FINITE, str(error))
        except NotUnitQuaternion as error:
            return IkResult.refused(IkStatus.NOT_UNIT_QUATERNION, str(error))
        resolved = self.robot.workspace.resolve(target, reference)
        if resolved.violation is not None:
            return IkResult.refused(IkStatus.OUTSIDE_WORKSPACE, resolved.violation)
        return _Target(target, resolved)

    def _remembered(
        self, previous: IkResult | FloatArray | None
    ) -> tuple[Numbers | None, FloatArray | None]:
        """Reference and joint positions of what came before."""
        if previous is None:
            return None, None
        if isinstance(previous, IkResult):
            return previous.reference, previous.joint_positions
        return self.robot.workspace.reference(previous), previous

    def _result(
        self, target: _Target, network_answer: FloatArray, previous: FloatArray | None
    ) -> IkResult:
        """The network's answer, polished if asked, checked, and as a result."""
        robot = self.robot
        answer = None
        if self.refines and all(map(math.isfinite, network_answer.tolist())):
            answer = self._refined(target, network_answer, previous)
            if not answer.converged:
                return _not_converged(answer)
        joint_positions = network_answer if answer is None else answer.joint_positions
        violation = robot.joint_limits.violation(joint_positions)
        if violation is not None:
            return IkResult.refused(IkStatus.JOINT_LIMIT, violation)
        if answer is None:
            residuals = robot.forward_kinematics.residuals(network_answer, target.pose)
            answer = Refined(network_answer, *residuals, 0, True)
        return self._accepted_or_refused(target, answer, previous)

    def _refined(
        self, target: _Target, network_answer: FloatArray, previous: FloatArray | None
    ) -> Refined:
        start = network_answer
        if self.seed_from_previous and previous is not None:
            function = self.robot.forward_kinematics.error_to(target.pose)
            start = min(
                (network_answer, previous),
                key=lambda positions: float(np.linalg.norm(function.error(positions).twist)),
            )
        return self._refinement.refined(start, target.pose)

    def _accepted_or_refused(
        self, target: _Target, answer: Refined, previous: FloatArray | None
    ) -> IkResult:
        """The last checks: residual, expected error and joint step."""
        status = IkStatus.RESIDUAL_TOO_LARGE
        violation = residual_violation(
            answer.position_residual, answer.orientation_residual, self.limits
        )
        expected = _UNKNOWN
        if violation is None and self._judges_expected_error:
            status = IkStatus.EXPECTED_ERROR_TOO_LARGE
            bound = self.robot.error_bound
            expected = _UNKNOWN if bound is None else bound.at(answer.joint_positions)
            violation = expected_error_violation(*expected, self.limits)
        if violation is None and previous is not None:
            status = IkStatus.JOINT_STEP_TOO_LARGE
            violation = joint_step_violation(
                self.robot.joint_names, answer.joint_positions, previous, self.limits
            )
        residuals = answer.position_residual, answer.orientation_residual, answer.newton_steps
        if violation is not None:
            return IkResult.refused(status, violation, *residuals)
        answer.joint_positions.setflags(write=False)
        return IkResult(
            IkStatus.SUCCESS,
            answer.joint_positions,
            *residuals,
            "",
            target.pose,
            target.resolved.reference,
            *expected,
        )


#: Of a robot that was not measured.
_UNKNOWN = (math.nan, math.nan)


class _Target(NamedTuple):
    """A target that may be answered.

    Attributes:
        pose: ``(7,)`` checked.
        resolved: as the network should see it.
    """

    pose: FloatArray
    resolved: ResolvedTarget


def _not_converged(answer: Refined) -> IkResult:
    return IkResult.refused(
        IkStatus.NOT_CONVERGED,
        f"{1e3 * answer.position_residual:.4g} mm and "
        f"{math.degrees(answer.orientation_residual):.4g} degrees are left after "
        f"{answer.newton_steps} steps: no solution in the working joint box was found",
        answer.position_residual,
        answer.orientation_residual,
        answer.newton_steps,
    )
