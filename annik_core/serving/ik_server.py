"""Serve a stream of targets: the part of the IK node that needs no ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray, Numbers
from annik_core.safety import (
    CommandSafety,
    FirstCommandRule,
    age_violation,
    box_violation,
    measured_violation,
    velocity_violation,
)
from annik_core.serving.statistics import SolveStatistics, SolveSummary
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.result import IkResult, IkStatus


@dataclass(frozen=True, eq=False)
class PathAnswer:
    """What became of a path of targets: all of it is answered, or nothing.

    Attributes:
        joint_positions: ``(n, dof)`` [rad or m], or None if the path was refused.
        refusal: of the first pose that can't be reached, naming it; None if the path is answered.
    """

    joint_positions: FloatArray | None
    refusal: IkResult | None


class IkServer:
    """Answers targets one after the other, each from the last command that was accepted.

    Attributes:
        solver: answers the targets; another for the same robot may take its place at any time.
        safety: what a command must satisfy besides; may be replaced at any time.
    """

    def __init__(
        self,
        solver: IkSolver,
        safety: CommandSafety | None = None,
        measure: Callable[[], FloatArray | None] = lambda: None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Serve with ``solver``.

        Args:
            solver: see the attribute.
            safety: see the attribute; by default :class:`CommandSafety`'s defaults.
            measure: the joint positions ``(dof,)`` [rad or m] where the robot is now, or None if
                nobody knows.
            clock: measures time [s] and never goes back.
        """
        self.solver = solver
        self.safety = safety or CommandSafety()
        self._measure = measure
        self._clock = clock
        self._previous: IkResult | None = None
        self._previous_time = -math.inf
        self._statistics = SolveStatistics(clock())

    def answer(self, pose: Numbers, frame_id: str = "", age: float | None = None) -> IkResult:
        """Answer one target, and count it.

        Args:
            pose: ``(7,)`` x, y, z [m], quaternion x, y, z, w, unchecked.
            frame_id: the frame that the pose is given in; empty means the base frame. A leading
                ``/`` is part of the name, as everywhere in ROS 2, and so is refused.
            age: how old the target is [s], negative for one from the future; None if it has no
                stamp.

        Returns:
            The answer or the refusal. Only an accepted one carries joint positions.
        """
        now = self._clock()
        refusal = self._refusal_of_header(frame_id, age)
        result = refusal or self._solve(pose, self._previous, now - self._previous_time)
        self._statistics.record(result, self._clock() - now)
        if result.accepted:
            self._previous, self._previous_time = result, now
        return result

    def answer_path(
        self,
        poses: FloatArray,
        interval: float,
        max_poses: int,
        frame_id: str = "",
        age: float | None = None,
    ) -> PathAnswer:
        """Answer a path of targets as one, and count it as one.

        Every pose is checked as a single target is, from the one before it. The path begins at the
        last command.

        Args:
            poses: ``(n, 7)`` unchecked.
            interval: time between two poses, and from the last command to the first [s].
            max_poses: longest path that is answered, which bounds the time.
            frame_id: as for :meth:`answer`.
            age: as for :meth:`answer`.
        """
        results, refusal = self._follow(poses, interval, max_poses, frame_id, age)
        if refusal is not None:
            self._statistics.record(refusal)
            return PathAnswer(None, refusal)
        self._statistics.record(results[-1])
        self._previous, self._previous_time = results[-1], self._clock()
        return PathAnswer(np.array([result.joint_positions for result in results]), None)

    def refuse(self, status: IkStatus, reason: str) -> IkResult:
        """Refuse what can't even be a target, and count it."""
        refusal = IkResult.refused(status, reason)
        self._statistics.record(refusal)
        return refusal

    def forget_last_command(self) -> None:
        """Take the next command for the first: the robot may have moved in the meantime."""
        self._previous, self._previous_time = None, -math.inf

    def load_model(self, path: str | Path) -> None:
        """Answer further targets with another model of the same robot.

        The file is validated before anything changes: if it is refused, the old model stays.

        Raises:
            RobotMismatch: if it is for another robot.
            ArtifactError: if it can't be used.
        """
        from annik_core.model.artifact import load_model

        artifact = load_model(path, expected_robot=self.solver.robot)
        self.solver = replace(self.solver, artifact=artifact)

    def record_latency(self, latency: float) -> None:
        """Note the time from the arrival of an accepted target to its command [s]."""
        self._statistics.record_latency(latency)

    def end_period(self) -> SolveSummary:
        """Sum up the answers so far, and begin a new period."""
        return self._statistics.end_period(self._clock())

    def _follow(
        self, poses: FloatArray, interval: float, max_poses: int, frame_id: str, age: float | None
    ) -> tuple[list[IkResult], IkResult | None]:
        """The answers to a path up to the first refusal, and that refusal."""
        if not 0 < len(poses) <= max_poses:
            reason = f"the path has {len(poses)} poses; it must have 1 to {max_poses}"
            return [], IkResult.refused(IkStatus.PATH_LENGTH, reason)
        refusal = self._refusal_of_header(frame_id, age)
        if refusal is not None:
            return [], refusal
        results: list[IkResult] = []
        previous = self._previous
        for pose in poses:
            result = self._solve(pose, previous, interval, on_the_way=bool(results))
            if not result.accepted:
                reason = f"pose {len(results)} of 0 to {len(poses) - 1}: {result.reason}"
                return results, replace(result, reason=reason)
            results.append(result)
            previous = result
        return results, None

    def _refusal_of_header(self, frame_id: str, age: float | None) -> IkResult | None:
        if frame_id and frame_id != (base_frame := self.solver.robot.base_frame):
            return IkResult.refused(
                IkStatus.WRONG_FRAME,
                f"the target is in frame {frame_id!r}; it must be in {base_frame!r}, "
                "the base frame of the model",
            )
        violation = age_violation(age, self.safety)
        if violation is not None:
            return IkResult.refused(IkStatus.STALE_TARGET, violation)
        return None

    def _solve(
        self,
        pose: Numbers,
        previous: IkResult | None,
        interval: float,
        on_the_way: bool = False,
    ) -> IkResult:
        """The answer to a pose, from the answer before it, given ``interval`` [s] ago.

        ``on_the_way``: the robot will come there later, so where it is now says nothing.
        """
        violation = box_violation(pose, self.safety)
        if violation is not None:
            return IkResult.refused(IkStatus.OUTSIDE_WORKSPACE_BOX, violation)
        try:
            if previous is None:
                return self._solve_first(pose)
            result = self.solver.solve(pose, previous)
        # Whatever it is: one bad target must not end the service of all others.
        except Exception as error:
            name = "" if isinstance(error, AnnikError) else f"{type(error).__name__}: "
            return IkResult.refused(IkStatus.SOLVER_FAILED, f"{name}{error}")
        if result.joint_positions is None or previous.joint_positions is None:
            return result
        names = self.solver.robot.joint_names
        violation = velocity_violation(
            names, result.joint_positions, previous.joint_positions, interval, self.safety
        )
        if violation is not None:
            return _withdrawn(result, IkStatus.JOINT_VELOCITY_TOO_LARGE, violation)
        limit = self.safety.max_measured_step
        if on_the_way or math.isinf(limit):
            return result
        return self._held_to(self._measure(), result, limit, IkStatus.TOO_FAR_FROM_MEASURED)

    def _solve_first(self, pose: Numbers) -> IkResult:
        rule = self.safety.first_command
        if rule is FirstCommandRule.FREE and math.isinf(self.safety.max_measured_step):
            return self.solver.solve(pose)
        measured = self._measure()
        if measured is None and rule is FirstCommandRule.NEAR:
            return IkResult.refused(
                IkStatus.FIRST_COMMAND_TOO_FAR,
                "where the robot is has not been measured, and the first command must be near it: "
                "publish joint_states, or set first_command to near_if_measured",
            )
        result = self.solver.solve(pose, measured)
        if rule is not FirstCommandRule.FREE:
            result = self._held_to(
                measured, result, self.safety.max_first_step, IkStatus.FIRST_COMMAND_TOO_FAR
            )
        return self._held_to(
            measured, result, self.safety.max_measured_step, IkStatus.TOO_FAR_FROM_MEASURED
        )

    def _held_to(
        self, measured: FloatArray | None, result: IkResult, limit: float, status: IkStatus
    ) -> IkResult:
        """The result, or its refusal if it is too far from where the robot is."""
        if measured is None or result.joint_positions is None:
            return result
        names = self.solver.robot.joint_names
        violation = measured_violation(names, result.joint_positions, measured, limit)
        return result if violation is None else _withdrawn(result, status, violation)


def _withdrawn(result: IkResult, status: IkStatus, reason: str) -> IkResult:
    """The refusal of an answer that the solver had accepted."""
    return IkResult.refused(
        status,
        reason,
        result.position_residual,
        result.orientation_residual,
        result.newton_steps,
    )
