"""The parameters of ``target_publisher``. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass

from annik_core.target_paths import TargetPath
from annik_ros.parameters import parameter, parameters_of


@dataclass(frozen=True)
class TargetPublisherParameters:
    """Parameters of ``target_publisher``."""

    path: TargetPath = parameters_of(TargetPath)
    rate: float = parameter(10.0, "Targets per second.", unit="Hz", minimum=1e-3, maximum=10_000.0)
    loops: int = parameter(
        1, "How often to follow the path; 0: without end.", minimum=0, maximum=1_000_000_000
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
        minimum=0,
        maximum=1000,
    )
    wait_timeout: float = parameter(
        30.0,
        "How long to wait for them, before the node ends with exit code 1.",
        unit="s",
        minimum=0.0,
        maximum=math.inf,
    )
    exit_when_done: bool = parameter(
        True, "End the process when every target is published and delivered."
    )
