"""Serve a stream of targets: the part of the IK node that needs no ROS."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from annik_core.artifact import load_artifact
from annik_core.errors import AnnikError
from annik_core.ik_result import IkResult, IkStatus
from annik_core.ik_solver import IkSolver
from annik_core.pose import FloatArray, checked_pose
from annik_core.solve_statistics import SolveStatistics, SolveSummary


@dataclass(frozen=True, eq=False)
class Command:
    """An accepted target, and where the joints are to go for it.

    Attributes:
        target: ``(7,)`` as it was checked, its quaternion normalised.
        joint_positions: ``(dof,)`` [rad or m], exactly those that passed the checks.
    """

    target: FloatArray
    joint_positions: FloatArray


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of one target.

    Attributes:
        result: the solver's answer, or the refusal.
        command: what to command; None if the target was refused.
    """

    result: IkResult
    command: Command | None


class IkServer:
    """Answers targets one after the other, each from the last command that was accepted.

    Attributes:
        solver: answers the targets; another for the same robot may take its place at any time.
    """

    def __init__(self, solver: IkSolver, clock: Callable[[], float] = time.perf_counter) -> None:
        """Serve with ``solver``; ``clock`` [s] measures solve times and never goes back."""
        self.solver = solver
        self._clock = clock
        self._previous: IkResult | None = None
        self._statistics = SolveStatistics(clock())

    def answer(self, pose: FloatArray, frame_id: str = "") -> Answer:
        """Answer one target, and count it.

        Args:
            pose: ``(7,)`` x, y, z [m], quaternion x, y, z, w, unchecked.
            frame_id: the frame that the pose is given in; empty means the base frame. A leading
                ``/`` is part of the name, as everywhere in ROS 2, and so is refused.

        Returns:
            The answer or the refusal. Only an accepted one carries joint positions.
        """
        start = self._clock()
        result = self._solve(pose, frame_id)
        self._statistics.record(result, self._clock() - start)
        if not result.accepted or result.joint_positions is None:
            return Answer(result, None)
        self._previous = result
        return Answer(result, Command(checked_pose(pose), result.joint_positions))

    def load_model(self, path: str | Path) -> None:
        """Answer further targets with another model of the same robot.

        The file is validated before anything changes: if it is refused, the old model stays.

        Raises:
            RobotMismatch: if it is for another robot.
            ArtifactError: if it can't be used.
        """
        artifact = load_artifact(path, expected_robot=self.solver.robot)
        self.solver = replace(self.solver, artifact=artifact)

    def end_period(self) -> SolveSummary:
        """Sum up the answers so far, and begin a new period."""
        return self._statistics.end_period(self._clock())

    def _solve(self, pose: FloatArray, frame_id: str) -> IkResult:
        base_frame = self.solver.robot.base_frame
        if frame_id not in ("", base_frame):
            return IkResult.refused(
                IkStatus.WRONG_FRAME,
                f"the target is in frame {frame_id!r}; it must be in {base_frame!r}, "
                "the base frame of the model",
            )
        try:
            return self.solver.solve(pose, self._previous)
        except AnnikError as error:
            # One bad target must not end the service of all others.
            return IkResult.refused(IkStatus.SOLVER_FAILED, str(error))
