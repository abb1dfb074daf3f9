"""The parameters of every node: name, default, unit, range, meaning. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

from annik_core.acceptance import AcceptanceLimits
from annik_core.collection_settings import CollectionSettings
from annik_core.command_safety import CommandSafety, FirstCommandRule
from annik_core.drawn_imperfections import (
    MAGNITUDES,
    ImperfectionMagnitudes,
    drawn_imperfections,
)
from annik_core.ik_solver import IkSolver, SolverMode
from annik_core.imperfections import LARGEST_SEED, Imperfections
from annik_core.imperfections_file import read_imperfections
from annik_core.refinement_options import RefinementOptions
from annik_core.robot import Robot
from annik_core.target_paths import DIAGONAL_POINTS
from annik_ros.parameter_table import InvalidParameter, Parameter, parameter, parameter_table
from msg_tools.topics import TOPICS

if TYPE_CHECKING:
    from annik_core.artifact import ModelArtifact


class OnRefusal(Enum):
    """What is published for a refused target: nothing, or the last command again."""

    SILENT = "silent"
    HOLD = "hold"


class ExecutorChoice(Enum):
    """Which of rclpy's executors calls a node back."""

    EVENTS = "events"
    SINGLE_THREADED = "single_threaded"


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
        "Largest change of any joint from the previous command, and of the first command from the "
        "measured joint positions; an answer beyond it is refused. Infinite: no limit.",
        unit="rad or m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_expected_error: float = parameter(
        AcceptanceLimits.max_expected_error,
        "Of a model that was learned from measured poses: largest distance by which the robot may "
        "miss where the model has it, for 95 of 100 poses; an answer beyond it is refused. "
        "Infinite: no limit.",
        unit="m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_expected_orientation_error: float = parameter(
        AcceptanceLimits.max_expected_orientation_error,
        "Likewise the angle.",
        unit="rad",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_joint_velocity: float = parameter(
        CommandSafety.max_joint_velocity,
        "Largest change of any joint from the previous command, by the time since it; an answer "
        "beyond it is refused. Infinite: no limit.",
        unit="rad/s or m/s",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    expected_rate: float = parameter(
        0.0,
        "How many targets a second should come. Fewer are a diagnostic warning, and commands that "
        "come closer together count as this far apart for max_joint_velocity. 0: not known.",
        unit="Hz",
        minimum=0.0,
        maximum=100_000.0,
        read_only=False,
    )
    max_measured_step: float = parameter(
        CommandSafety.max_measured_step,
        "Largest distance of any joint of a command from its measured position, if joint_states "
        "are there; an answer beyond it is refused. Infinite: no limit.",
        unit="rad or m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    first_command: str = parameter(
        CommandSafety.first_command.value,
        "How the first command after an activation is held to max_first_step. near_if_measured: "
        "if joint_states are there; near: without them it is refused; free: not at all.",
        choices=tuple(rule.value for rule in FirstCommandRule),
        read_only=False,
    )
    max_first_step: float = parameter(
        CommandSafety.max_first_step,
        "Largest distance of any joint of the first command from its measured position.",
        unit="rad or m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    measurement_timeout: float = parameter(
        0.5,
        "Joint positions that were measured longer ago than this count for nothing.",
        unit="s",
        minimum=1e-3,
        maximum=3600.0,
        read_only=False,
    )
    workspace_box_lower: tuple[float, ...] = parameter(
        CommandSafety.workspace_box_lower,
        "Least x, y, z of a target in the base frame; a target beyond is refused.",
        unit="m",
        minimum=-math.inf,
        maximum=math.inf,
        read_only=False,
    )
    workspace_box_upper: tuple[float, ...] = parameter(
        CommandSafety.workspace_box_upper,
        "Greatest x, y, z of a target in the base frame; a target beyond is refused.",
        unit="m",
        minimum=-math.inf,
        maximum=math.inf,
        read_only=False,
    )
    max_target_age: float = parameter(
        CommandSafety.max_target_age,
        "Oldest that a stamped target may be, by its stamp and the node's clock, or furthest in "
        "the future; one beyond is refused, and so is one without a stamp. Infinite: no limit.",
        unit="s",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    on_refusal: str = parameter(
        OnRefusal.SILENT.value,
        "What is published for a refused target. silent: nothing; hold: the last command again, "
        "with a new stamp, for controllers that stop without one.",
        choices=tuple(choice.value for choice in OnRefusal),
        read_only=False,
    )
    publish_joint_trajectory: bool = parameter(
        False, "Publish each command on joint_trajectory too, as one point.", read_only=False
    )
    publish_position_commands: bool = parameter(
        False, "Publish each command on position_commands too.", read_only=False
    )
    trajectory_interval: float = parameter(
        0.1,
        "Time that a trajectory gives its robot from point to point, and to the first.",
        unit="s",
        minimum=1e-3,
        maximum=1000.0,
        read_only=False,
    )
    max_path_poses: int = parameter(
        1000,
        "Most poses in target_poses, which bounds the time of an answer; other targets wait.",
        minimum=1,
        maximum=1_000_000,
        read_only=False,
    )
    queue_depth: int = parameter(
        1,
        "How many targets may wait while one is answered. 1: the newest replaces the one that "
        "waits, which is what a controller wants; more: none is left out in a burst.",
        minimum=1,
        maximum=100_000,
    )
    autostart: bool = parameter(
        True, "Configure and activate at the start; false: wait for lifecycle transitions."
    )
    executor: str = parameter(
        ExecutorChoice.EVENTS.value,
        "What calls the node back. events: rclpy's events executor, the quicker one; "
        "single_threaded: rclpy's default.",
        choices=tuple(choice.value for choice in ExecutorChoice),
    )

    def __post_init__(self) -> None:
        """Refuse limits that contradict each other.

        Raises:
            InvalidSafetyLimit: naming the one and the other.
        """
        _ = self.command_safety

    @property
    def command_safety(self) -> CommandSafety:
        """What commands are held to, as the server takes it."""
        return CommandSafety(
            workspace_box_lower=self.workspace_box_lower,
            workspace_box_upper=self.workspace_box_upper,
            max_target_age=self.max_target_age,
            max_joint_velocity=self.max_joint_velocity,
            shortest_interval=1.0 / self.expected_rate if self.expected_rate > 0 else 0.0,
            max_measured_step=self.max_measured_step,
            first_command=FirstCommandRule(self.first_command),
            max_first_step=self.max_first_step,
        )

    @property
    def acceptance_limits(self) -> AcceptanceLimits:
        """The limits as the solver takes them."""
        names = (entry.name for entry in fields(AcceptanceLimits))
        return AcceptanceLimits(**{name: getattr(self, name) for name in names})

    def solver(self, artifact: ModelArtifact) -> IkSolver:
        """The solver that they describe, for a model."""
        return IkSolver(
            artifact,
            self.acceptance_limits,
            SolverMode(self.mode),
            RefinementOptions(self.max_newton_steps, self.refinement_tolerance),
            self.seed_from_previous,
        )


def _magnitude(name: str, description: str) -> float:
    """A parameter for one of :class:`ImperfectionMagnitudes`."""
    allowed = MAGNITUDES[name]
    default: float = getattr(ImperfectionMagnitudes, name)
    return parameter(
        default, description, unit=allowed.unit, minimum=allowed.lower, maximum=allowed.upper
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
    imperfections: str = parameter(
        "",
        "Path of a file with the errors of an imperfect arm, such as config/imperfect_ur5e.yaml; "
        "empty: see imperfection_seed.",
    )
    imperfection_seed: int = parameter(
        -1,
        "Draw the errors of an imperfect arm, each evenly up to the magnitudes below, and the "
        "noise of its measurements. One seed, one arm; -1: a perfect robot.",
        minimum=-1,
        maximum=LARGEST_SEED,
    )
    joint_zero_error: float = _magnitude(
        "joint_zero_error", "Largest error of a joint's zero, of those drawn."
    )
    link_length_error: float = _magnitude(
        "link_length_error",
        "Largest error of a link's length and of a joint's offset along its axis, of those drawn.",
    )
    link_twist_error: float = _magnitude(
        "link_twist_error", "Largest error of a link's twist, of those drawn."
    )
    transmission_error: float = _magnitude(
        "transmission_error",
        "Largest amplitude of the error that comes again with every turn of a joint, of those "
        "drawn.",
    )
    backlash: float = _magnitude(
        "backlash", "Largest play between the drive of a joint and the joint, of those drawn."
    )
    position_noise: float = _magnitude(
        "position_noise",
        "Standard deviation of a measured position along each axis, with imperfection_seed.",
    )
    orientation_noise: float = _magnitude(
        "orientation_noise",
        "Standard deviation of a measured orientation about each axis, with imperfection_seed.",
    )
    dropped_measurements: float = _magnitude(
        "dropped_measurements",
        "Probability that a measurement is lost, with imperfection_seed.",
    )
    measurement_rate: float = parameter(
        0.0,
        "How often to publish measured_pose, as a tracker does, and joint_states with the same "
        "stamp. 0: never.",
        unit="Hz",
        minimum=0.0,
        maximum=10_000.0,
    )

    def __post_init__(self) -> None:
        """Refuse parameters that contradict each other.

        Raises:
            InvalidParameter: naming the one and the other.
        """
        if self.imperfection_seed < 0:
            for name, default in vars(ImperfectionMagnitudes()).items():
                if getattr(self, name) != default:
                    raise InvalidParameter(
                        name, getattr(self, name), f"{default:g} without imperfection_seed"
                    )
        elif self.imperfections:
            raise InvalidParameter(
                "imperfection_seed",
                self.imperfection_seed,
                "-1 beside imperfections, a file that has them",
            )

    def robot_imperfections(self, robot: Robot) -> Imperfections | None:
        """What the robot differs in from its description; None: nothing.

        Raises:
            AnnikError: if the file or the robot can't be used.
        """
        if self.imperfections:
            return read_imperfections(self.imperfections, robot)
        if self.imperfection_seed < 0:
            return None
        magnitudes = ImperfectionMagnitudes(
            **{name: getattr(self, name) for name in vars(ImperfectionMagnitudes())}
        )
        return drawn_imperfections(robot, self.imperfection_seed, magnitudes)


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


@dataclass(frozen=True)
class ExampleCollectorParameters:
    """Parameters of ``example_collector``."""

    plan: str = parameter(
        "",
        "Path of the dataset whose joint positions to measure at, as annik design --out writes "
        "it; must be given.",
    )
    dataset: str = parameter(
        "",
        "Path of the dataset (.npz) to write; must be given. Beside it is the journal, NAME"
        ".journal.jsonl, from which a collection that was interrupted goes on.",
    )
    command_rate: float = parameter(
        CollectionSettings.command_rate,
        "Commands per second, also while the robot is to stand still.",
        unit="Hz",
        minimum=1.0,
        maximum=1000.0,
    )
    max_joint_velocity: float = parameter(
        CollectionSettings.max_joint_velocity,
        "Speed of the joint that moves furthest; the others arrive at the same time.",
        unit="rad/s or m/s",
        minimum=1e-6,
        maximum=1000.0,
    )
    max_joint_acceleration: float = parameter(
        CollectionSettings.max_joint_acceleration,
        "How quickly that joint speeds up and slows down.",
        unit="rad/s^2 or m/s^2",
        minimum=1e-6,
        maximum=100_000.0,
    )
    max_measured_step: float = parameter(
        CollectionSettings.max_measured_step,
        "Largest distance of a measured joint from its command, and from where it was measured "
        "before; beyond it the node stops, with exit code 1. Infinite: no limit.",
        unit="rad or m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
    )
    measurement_timeout: float = parameter(
        CollectionSettings.measurement_timeout,
        "Longest silence of joint_states; after it the node stops, with exit code 1.",
        unit="s",
        minimum=1e-3,
        maximum=3600.0,
    )
    workspace_box_lower: tuple[float, ...] = parameter(
        CollectionSettings.workspace_box_lower,
        "Least x, y, z of the end effector in the base frame, by the forward kinematics, at the "
        "examples and on the way; an example that can't be gone to inside is skipped.",
        unit="m",
        minimum=-math.inf,
        maximum=math.inf,
    )
    workspace_box_upper: tuple[float, ...] = parameter(
        CollectionSettings.workspace_box_upper,
        "Greatest x, y, z, likewise.",
        unit="m",
        minimum=-math.inf,
        maximum=math.inf,
    )
    settle_tolerance: float = parameter(
        CollectionSettings.settle_tolerance,
        "The robot stands still when no measured joint is further than this from its command, "
        "or moves more,",
        unit="rad or m",
        minimum=_SMALLEST_LIMIT,
        maximum=1000.0,
    )
    settle_time: float = parameter(
        CollectionSettings.settle_time,
        "for this long. Longer than measured_pose is late, or poses from before are averaged too.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    settle_timeout: float = parameter(
        CollectionSettings.settle_timeout,
        "An example at which the robot does not stand still after this time has failed for now.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    samples: int = parameter(
        CollectionSettings.samples,
        "How many measured poses are averaged for an example. A journal keeps to its number.",
        minimum=1,
        maximum=100_000,
    )
    pose_timeout: float = parameter(
        CollectionSettings.pose_timeout,
        "Longest wait for so many.",
        unit="s",
        minimum=1e-3,
        maximum=3600.0,
    )
    max_position_spread: float = parameter(
        CollectionSettings.max_position_spread,
        "Largest distance of a sample from the mean; beyond it, or if one sample is far from the "
        "others, it is measured again.",
        unit="m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_orientation_spread: float = parameter(
        CollectionSettings.max_orientation_spread,
        "Largest angle of a sample from the mean, likewise.",
        unit="rad",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_position_deviation: float = parameter(
        CollectionSettings.max_position_deviation,
        "Largest distance of the mean from the nominal forward kinematics; beyond it, it is "
        "measured again.",
        unit="m",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_orientation_deviation: float = parameter(
        CollectionSettings.max_orientation_deviation,
        "Largest angle of the mean from the nominal forward kinematics, likewise.",
        unit="rad",
        minimum=_SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_repeats: int = parameter(
        CollectionSettings.max_repeats,
        "How often an example is measured again before it has failed for now.",
        minimum=0,
        maximum=1000,
    )
    max_retries: int = parameter(
        CollectionSettings.max_retries,
        "How often an example that failed is gone to again, after all others.",
        minimum=0,
        maximum=1000,
    )
    max_failures_in_a_row: int = parameter(
        CollectionSettings.max_failures_in_a_row,
        "After so many the node stops, with exit code 1: something is wrong with the set-up.",
        minimum=1,
        maximum=1_000_000,
    )
    wait_timeout: float = parameter(
        60.0,
        "How long to wait at the start for joint_states, measured_pose and a subscriber of "
        "joint_command before giving up with exit code 1.",
        unit="s",
        minimum=0.0,
        maximum=math.inf,
    )

    def __post_init__(self) -> None:
        """Refuse what contradicts itself or the other.

        Raises:
            AnnikError: naming what.
        """
        _ = self.settings

    @property
    def settings(self) -> CollectionSettings:
        """What the collector is to keep to."""
        names = (entry.name for entry in fields(CollectionSettings))
        return CollectionSettings(**{name: getattr(self, name) for name in names})

    @property
    def paths(self) -> tuple[Path, Path]:
        """Where the plan is, and where the dataset goes.

        Raises:
            InvalidParameter: if one is not given, or both are the same.
        """
        for name in ("plan", "dataset"):
            if not getattr(self, name):
                raise InvalidParameter(name, "", "the path of a file")
        plan, dataset = Path(self.plan), Path(self.dataset)
        if dataset.suffix != ".npz":
            raise InvalidParameter("dataset", self.dataset, "the path of a file that ends in .npz")
        if plan.resolve() == dataset.resolve():
            raise InvalidParameter("dataset", self.dataset, "another file than the plan")
        return plan, dataset


#: The parameter table of each node, by the node's name.
PARAMETER_TABLES: dict[str, tuple[Parameter, ...]] = {
    "ik_node": parameter_table(IkNodeParameters),
    "fake_robot": parameter_table(FakeRobotParameters),
    "target_publisher": parameter_table(TargetPublisherParameters),
    "bag_recorder": parameter_table(BagRecorderParameters),
    "example_collector": parameter_table(ExampleCollectorParameters),
}
