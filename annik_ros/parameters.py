"""The parameters of every node: name, default, unit, range, meaning. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass

from annik_core.acceptance import AcceptanceLimits
from annik_core.artifact import ModelArtifact
from annik_core.ik_solver import IkSolver, SolverMode
from annik_core.refinement import RefinementOptions
from annik_core.target_paths import DIAGONAL_POINTS
from annik_ros.parameter_table import Parameter, parameter, parameter_table
from msg_tools.topics import TOPICS

#: The least limit that can be set: a limit must be greater than 0.
_SMALLEST_LIMIT = 1e-12


@dataclass(frozen=True)
class IkNodeParameters:
    """Parameters of ``ik_node``."""

    model: str = parameter(
        "",
        "Path of the model file, or name of a packaged model; empty: the packaged gantry model. A "
        "change takes effect when ~/reload_model is called.",
        read_only=False,
    )
    mode: str = parameter(
        SolverMode.AUTO.value,
        "What answers a target. network: the network alone, as in the paper; refined: its answer, "
        "polished on the forward kinematics inside the working joint box; auto: refined for an "
        "arm, network for the gantry.",
        choices=tuple(mode.value for mode in SolverMode),
        read_only=False,
    )
    max_newton_steps: int = parameter(
        RefinementOptions.max_newton_steps,
        "Most steps of the refinement, which bounds the time of an answer; what has not converged "
        "by then is refused.",
        minimum=0,
        maximum=1000,
        read_only=False,
    )
    refinement_tolerance: float = parameter(
        RefinementOptions.tolerance,
        "The refinement is done when distance and angle to the target are at most this.",
        unit="m and rad",
        minimum=1e-12,
        maximum=1.0,
        read_only=False,
    )
    seed_from_previous: bool = parameter(
        False,
        "Begin the refinement at the last command where its pose is nearer to the target than the "
        "network's answer. True: an answer may depend on those before it; false: on the target "
        "alone.",
        read_only=False,
    )
    max_position_residual: float = parameter(
        AcceptanceLimits.max_position_residual,
        "Largest distance between the target and where the joint positions lead; an answer "
        "beyond it is refused.",
        unit="m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_orientation_residual: float = parameter(
        AcceptanceLimits.max_orientation_residual,
        "Largest angle between the target's orientation and where the joint positions lead; an "
        "answer beyond it is refused.",
        unit="rad",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_joint_step: float = parameter(
        AcceptanceLimits.max_joint_step,
        "Largest change of any joint from the previous command; an answer beyond it is refused. "
        "Infinite: no limit.",
        unit="rad or m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    queue_depth: int = parameter(
        1,
        "How many targets may wait while one is answered. 1: the newest replaces the one that "
        "waits, which is what a controller wants; more: none is left out in a burst.",
        minimum=1,
        maximum=100_000,
    )

    @property
    def acceptance_limits(self) -> AcceptanceLimits:
        """The three limits as the solver takes them."""
        return AcceptanceLimits(
            self.max_position_residual, self.max_orientation_residual, self.max_joint_step
        )

    def solver(self, artifact: ModelArtifact) -> IkSolver:
        """The solver that they describe, for a model."""
        return IkSolver(
            artifact,
            self.acceptance_limits,
            SolverMode(self.mode),
            RefinementOptions(self.max_newton_steps, self.refinement_tolerance),
            self.seed_from_previous,
        )


@dataclass(frozen=True)
class FakeRobotParameters:
    """Parameters of ``fake_robot``."""

    model: str = parameter(
        "",
        "Path of a model file, or name of a packaged model, whose robot to stand in for; empty: "
        "see robot_description.",
    )
    robot_description: str = parameter(
        "", "Text of a URDF to stand in for if no model is given; empty: see robot."
    )
    robot: str = parameter(
        "gantry",
        "Packaged robot, or path of a robot definition or URDF, to stand in for if neither a "
        "model nor a robot_description is given.",
    )
    base_frame: str = parameter(
        "", "Of an arm's URDF: the link that poses are given in; empty: its root, or as defined."
    )
    end_effector_frame: str = parameter(
        "", "Of an arm's URDF: the link whose pose it is; empty: its only tip, or as defined."
    )


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


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of ``bag_recorder``."""

    output: str = parameter(
        "",
        "Folder of the bag, new or empty; empty: annik_bag_<date>_<time>, where it was started.",
    )
    topics: tuple[str, ...] = parameter(
        tuple(topic.name for topic in TOPICS),
        "Topics to record, relative or absolute; by default all of annik's.",
    )
    duration: float = parameter(
        0.0,
        "How long to record once subscribed; 0: until stopped.",
        unit="s",
        minimum=0.0,
        maximum=1e9,
    )


#: The parameter table of each node, by the node's name.
PARAMETER_TABLES: dict[str, tuple[Parameter, ...]] = {
    "ik_node": parameter_table(IkNodeParameters),
    "fake_robot": parameter_table(FakeRobotParameters),
    "target_publisher": parameter_table(TargetPublisherParameters),
    "bag_recorder": parameter_table(BagRecorderParameters),
}
