"""The parameters of ``ik_node``. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import Enum
from typing import TYPE_CHECKING

from annik_core.safety import AcceptanceLimits, CommandSafety, FirstCommandRule
from annik_core.solver.ik_solver import IkSolver, SolverMode
from annik_core.solver.options import RefinementOptions
from annik_ros.executor_choice import ExecutorChoice
from annik_ros.parameters import SMALLEST_LIMIT, parameter

if TYPE_CHECKING:
    from annik_core.model.artifact import Model


class OnRefusal(Enum):
    """What is published for a refused target: nothing, or the last command again."""

    SILENT = "silent"
    HOLD = "hold"


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
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_orientation_residual: float = parameter(
        AcceptanceLimits.max_orientation_residual,
        "Largest angle between the target's orientation and where the joint positions lead; an "
        "answer beyond it is refused.",
        unit="rad",
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_joint_step: float = parameter(
        AcceptanceLimits.max_joint_step,
        "Largest change of any joint from the previous command, and of the first command from the "
        "measured joint positions; an answer beyond it is refused. Infinite: no limit.",
        unit="rad or m",
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_expected_error: float = parameter(
        AcceptanceLimits.max_expected_error,
        "Of a model that was learned from measured poses: largest distance by which the robot may "
        "miss where the model has it, for 95 of 100 poses; an answer beyond it is refused. "
        "Infinite: no limit.",
        unit="m",
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_expected_orientation_error: float = parameter(
        AcceptanceLimits.max_expected_orientation_error,
        "Likewise the angle.",
        unit="rad",
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
        read_only=False,
    )
    max_joint_velocity: float = parameter(
        CommandSafety.max_joint_velocity,
        "Largest change of any joint from the previous command, by the time since it; an answer "
        "beyond it is refused. Infinite: no limit.",
        unit="rad/s or m/s",
        minimum=SMALLEST_LIMIT,
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
        minimum=SMALLEST_LIMIT,
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
        minimum=SMALLEST_LIMIT,
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
        minimum=SMALLEST_LIMIT,
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
            InvalidValue: naming the one and the other.
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
            expected_rate=self.expected_rate,
            max_measured_step=self.max_measured_step,
            first_command=FirstCommandRule(self.first_command),
            max_first_step=self.max_first_step,
        )

    @property
    def acceptance_limits(self) -> AcceptanceLimits:
        """The limits as the solver takes them."""
        names = (entry.name for entry in fields(AcceptanceLimits))
        return AcceptanceLimits(**{name: getattr(self, name) for name in names})

    def solver(self, artifact: Model) -> IkSolver:
        """The solver that they describe, for a model."""
        return IkSolver(
            artifact,
            self.acceptance_limits,
            SolverMode(self.mode),
            RefinementOptions(self.max_newton_steps, self.refinement_tolerance),
            self.seed_from_previous,
        )
