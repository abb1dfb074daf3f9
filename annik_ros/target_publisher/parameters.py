"""The parameters of ``target_publisher``. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass

from annik_core.target_paths import DIAGONAL_POINTS
from annik_ros.parameters import parameter


@dataclass(frozen=True)
class TargetPublisherParameters:
    """Parameters of ``target_publisher``."""

    path: str = parameter(
        "diagonal",
        "Which path to publish. diagonal: the paper's test path.",
        choices=("diagonal", "line", "circle", "csv"),
    )
    points: int = parameter(
        DIAGONAL_POINTS,
        "How many targets the path has; csv: as many as the file has, whatever this says.",
        minimum=2,
        maximum=10_000_000,
    )
    rate: float = parameter(10.0, "Targets per second.", unit="Hz", minimum=1e-3, maximum=10_000.0)
    loops: int = parameter(
        1, "How many times to follow the path; 0: for ever.", minimum=0, maximum=1_000_000_000
    )
    stamped: bool = parameter(
        False, "Publish PoseStamped on target_pose_stamped instead of Pose on target_pose."
    )
    frame_id: str = parameter(
        "", "Frame of the stamped targets; empty means the base frame of the robot."
    )
    wait_for_subscribers: int = parameter(
        1,
        "How many subscribers must listen before the first target is published.",
        minimum=0,
        maximum=1000,
    )
    wait_timeout: float = parameter(
        30.0,
        "How long to wait for them before giving up with exit code 1.",
        unit="s",
        minimum=0.0,
        maximum=math.inf,
    )
    exit_when_done: bool = parameter(
        True, "End the process when every target is published and delivered."
    )
    csv_file: str = parameter(
        "", "For csv: file with the header x,y,z,qx,qy,qz,qw [m, unit quaternion]."
    )
    line_from_position: tuple[float, ...] = parameter(
        (0.25, 0.25, 0.55), "For line: first position x, y, z.", unit="m"
    )
    line_from_roll_pitch_yaw: tuple[float, ...] = parameter(
        (0.5, 0.5, 0.5), "For line: first orientation, about the fixed x, y, z axes.", unit="rad"
    )
    line_to_position: tuple[float, ...] = parameter(
        (0.45, 0.45, 0.75), "For line: last position x, y, z.", unit="m"
    )
    line_to_roll_pitch_yaw: tuple[float, ...] = parameter(
        (0.5, 0.5, 0.5), "For line: last orientation, about the fixed x, y, z axes.", unit="rad"
    )
    circle_centre: tuple[float, ...] = parameter(
        (0.35, 0.35, 0.65), "For circle: centre x, y, z.", unit="m"
    )
    circle_radius: float = parameter(
        0.1,
        "For circle: radius, in the plane of constant z.",
        unit="m",
        minimum=1e-6,
        maximum=1000.0,
    )
    circle_roll_pitch_yaw: tuple[float, ...] = parameter(
        (0.5, 0.5, 0.5), "For circle: orientation, about the fixed x, y, z axes.", unit="rad"
    )
