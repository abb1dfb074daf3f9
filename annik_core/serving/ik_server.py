"""Serve a stream of targets: the part of the IK node that needs no ROS."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray, Numbers
from annik_core.safety import (
    NOT_MEASURED,
    CommandSafety,
    IkStatus,
    Measurement,
    Motion,
    Refusal,
    check_age,
    check_frame,
    check_path_length,
    check_workspace_box,
)
from annik_core.serving.statistics import SolveStatistics, SolveSummary
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.result import IkResult


@dataclass(frozen=True, eq=False)
class PathResult:
    """Outcome of a path of targets, which is accepted or refused as a whole.

    Attributes:
        joint_positions: ``(n, dof)`` [rad or m], or None if the path was refused.
        refusal: of the first pose that was refused, naming it; None if the path was accepted.
    """

    joint_positions: FloatArray | None
    refusal: IkResult | None


class IkServer:
    """Solves targets one after the other, each from the last command that was accepted.

    Solver, for the same robot, and safety may be replaced at any time.
    """

    def __init__(
        self,
        solver: IkSolver,
        safety: CommandSafety | None = None,
        measure: Callable[[], Measurement] = Measurement,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Serve with ``solver``, times [s] by ``clock``, which never goes back."""
        self.solver = solver
        self.safety = safety or CommandSafety()
        self._measure = measure
        self._clock = clock
        self._previous: IkResult | None = None
        self._previous_time = -math.inf
        self._statistics = SolveStatistics(clock())

    def solve(self, pose: Numbers, frame_id: str = "", age: float | None = None) -> IkResult:
        """Solve one target ``(7,)``, unchecked, and count it.

        Args:
            pose: x, y, z [m], quaternion x, y, z, w.
            frame_id: the frame that the pose is given in; empty means the base frame. A leading
                ``/`` is part of the name, as everywhere in ROS 2, and so is refused.
            age: how old the target is [s], negative for one from the future; None if it has no
                stamp.
        """
        now = self._clock()
        refusal = None
        if frame_id or age is not None:
            refusal = self._check_header(frame_id, age)
        if refusal is None:
            result = self._solve(pose, self._previous, now - self._previous_time)
        else:
            result = IkResult.refused(refusal)
        self._statistics.record(result, self._clock() - now)
        if result.accepted:
            self._previous, self._previous_time = result, now
        return result

    def solve_path(
        self,
        poses: FloatArray,
        interval: float,
        max_poses: int,
        frame_id: str = "",
        age: float | None = None,
    ) -> PathResult:
        """Solve a path of targets ``(n, 7)``, unchecked, as one, and count it as one.

        Every pose is checked as by :meth:`solve`, from the one before it, the first from the last
        command; ``interval`` [s] is the time between two of them. ``max_poses`` bounds the time.
        """
        results = self._follow(poses, interval, max_poses, frame_id, age)
        if isinstance(results, IkResult):
            self._statistics.record(results)
            return PathResult(None, results)
        self._statistics.record(results[-1])
        self._previous, self._previous_time = results[-1], self._clock()
        return PathResult(np.array([result.joint_positions for result in results]), None)

    def solutions(
        self,
        pose: Numbers,
        frame_id: str = "",
        near: FloatArray | None = None,
        *,
        turns: bool = False,
    ) -> list[IkResult] | Refusal:
        """All solutions of a pose ``(7,)``, unchecked, or why it is refused; counted apart.

        The nearest first: to joint positions ``(dof,)``; by default to the measured ones, where
        they are unknown to the last command, without one to the middle of the joint limits.
        ``turns``: see :meth:`annik_core.solver.ik_solver.IkSolver.solutions`.
        """
        refusal = check_frame(frame_id, self.solver.robot.base_frame)
        refusal = refusal or check_workspace_box(pose, self.safety)
        found: list[IkResult] = []
        if refusal is None:
            if near is None:
                near = self._measure().joint_positions
            if near is None and self._previous is not None:
                near = self._previous.joint_positions
            found = self.solver.solutions(pose, near, turns=turns)
        self._statistics.record_solutions(len(found))
        return refusal or found

    def refuse(self, status: IkStatus, reason: str) -> IkResult:
        """Refuse what can't even be a target, and count it."""
        refusal = IkResult.refused(Refusal(status, reason))
        self._statistics.record(refusal)
        return refusal

    def forget_last_command(self) -> None:
        """Treat the next command as the first: the robot may have moved in the meantime."""
        self._previous, self._previous_time = None, -math.inf

    def load_model(self, path: str | Path) -> None:
        """Solve further targets with another model of the same robot.

        The file is validated before anything changes: if it is refused, the old model stays.

        Raises:
            RobotMismatch: if it is for another robot.
            ModelError: if it can't be used.
        """
        from annik_core.model.artifact import load_model

        model = load_model(path, expected_robot=self.solver.robot)
        self.solver = replace(self.solver, artifact=model)

    def record_latency(self, latency: float) -> None:
        """Note the time from the arrival of an accepted target to its command [s]."""
        self._statistics.record_latency(latency)

    def begin_period(self) -> None:
        """Begin a new period, when nobody wants to know of the last."""
        self._statistics.begin_period(self._clock())

    def end_period(self) -> SolveSummary:
        """Sum up the outcomes so far, and begin a new period."""
        return self._statistics.end_period(self._clock())

    def _follow(
        self, poses: FloatArray, interval: float, max_poses: int, frame_id: str, age: float | None
    ) -> list[IkResult] | IkResult:
        refusal = self._check_header(frame_id, age) or check_path_length(len(poses), max_poses)
        if refusal is not None:
            return IkResult.refused(refusal)
        results: list[IkResult] = []
        previous = self._previous
        for pose in poses:
            result = self._solve(pose, previous, interval, later=bool(results))
            if not result.accepted:
                reason = f"pose {len(results)} of 0 to {len(poses) - 1}: {result.reason}"
                return replace(result, reason=reason)
            results.append(result)
            previous = result
        return results

    def _check_header(self, frame_id: str, age: float | None) -> Refusal | None:
        return check_frame(frame_id, self.solver.robot.base_frame) or check_age(age, self.safety)

    def _solve(
        self, pose: Numbers, previous: IkResult | None, interval: float, later: bool = False
    ) -> IkResult:
        """The result for a pose, ``interval`` [s] after the command before it.

        ``later``: the robot comes there later, so its measured joint positions do not matter.
        """
        refusal = check_workspace_box(pose, self.safety)
        if refusal is not None:
            return IkResult.refused(refusal)
        try:
            measured = NOT_MEASURED if later else self._measured(first=previous is None)
            if previous is None:
                motion = Motion(self.safety, None, measured)
                return self.solver.solve(pose, measured.joint_positions, motion)
            return self.solver.solve(pose, previous, Motion(self.safety, interval, measured))
        # Whatever it is: one bad target must not end the service of all others.
        except Exception as error:
            name = "" if isinstance(error, AnnikError) else f"{type(error).__name__}: "
            return IkResult.refused(Refusal(IkStatus.SOLVER_FAILED, f"{name}{error}"))

    def _measured(self, first: bool) -> Measurement:
        """Where the robot is, if a check or the first solution depends on it."""
        needed = first or not math.isinf(self.safety.max_measured_step)
        return self._measure() if needed else NOT_MEASURED
