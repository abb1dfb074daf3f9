"""The parameters of ``target_publisher``. Needs no ROS."""

import math
from dataclasses import dataclass
from enum import Enum

from annik_core.pose import FloatArray
from annik_core.target_paths import PathKind, TargetPath
from annik_ros.parameters import parameter, parameters_of


class ExpectedResults(Enum):
    """What must come of every target: nothing, a command, or a command that the robot follows."""

    NONE = "none"
    ACCEPTED = "accepted"
    ACHIEVED = "achieved"


@dataclass(frozen=True)
class TargetPublisherParameters:
    """Parameters of ``target_publisher``."""

    model: str = parameter(
        "",
        "Path of a model file, or name of a packaged model, whose robot is to follow the path; "
        "empty: the packaged gantry model. If the default path does not suit the robot, numbers "
        "of a line or a circle that were not changed are chosen inside its joint box, and the "
        "diagonal is straight in joint space.",
    )
    path: TargetPath = parameters_of(TargetPath)
    rate: float = parameter(10.0, "Targets per second.", unit="Hz", within=(1e-3, 10_000.0))
    loops: int = parameter(
        1, "How often to follow the path; 0: without end.", within=(0, 1_000_000_000)
    )
    stamped: bool = parameter(
        False, "Publish PoseStamped on target_pose_stamped instead of Pose on target_pose."
    )
    frame_id: str = parameter(
        "", "Frame of the stamped targets; empty: the base frame of the robot."
    )
    wait_for_subscribers: int = parameter(
        1,
        "How many subscribers there must be before the first target is published.",
        within=(0, 1000),
    )
    wait_timeout: float = parameter(
        30.0,
        "How long to wait for them, before the node ends with exit code 1.",
        unit="s",
        within=(0.0, math.inf),
    )
    expected_results: ExpectedResults = parameter(
        ExpectedResults.NONE,
        "What must come of every target. none: nothing; accepted: its accepted_target; achieved: "
        "its tracking_error/position too, from fake_robot. If something lacks, the node ends with "
        "exit code 1.",
    )
    exit_when_done: bool = parameter(
        True, "End the process when every target is published and delivered."
    )

    def poses(self) -> FloatArray:
        """The targets ``(n, 7)`` of one loop.

        Raises:
            AnnikError: if a number is out of range, or a file or the model can't be used.
        """
        if not self.model or self.path.path is PathKind.CSV:
            return self.path.poses()
        from annik_core.reachable_paths import reachable_path
        from annik_core.solver.ik_solver import IkSolver

        return reachable_path(self.path, IkSolver.from_file(self.model))
