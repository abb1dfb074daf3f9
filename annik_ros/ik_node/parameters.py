"""The parameters of ``ik_node``. Needs no ROS."""

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from annik_core.safety import AcceptanceLimits, CommandSafety
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import RefinementOptions
from annik_core.solver.search import SearchOptions
from annik_ros.parameters import ExecutorChoice, changeable, parameter, parameters_of

if TYPE_CHECKING:
    from annik_core.model.artifact import Model
    from annik_core.solver.ik_solver import IkSolver

#: The service that loads the model file anew.
RELOAD_MODEL = "~/reload_model"
#: The service of MoveIt for inverse kinematics.
COMPUTE_IK = "~/compute_ik"


class OnRefusal(Enum):
    """What is published for a refused target: nothing, or the last command again."""

    SILENT = "silent"
    HOLD = "hold"


@dataclass(frozen=True)
class IkNodeParameters:
    """Parameters of ``ik_node``."""

    model: str = changeable(
        "",
        "Path of the model file, or name of a packaged model; empty: the packaged gantry model. A "
        "change takes effect when ~/reload_model is called.",
    )
    mode: SolverMode = changeable(
        SolverMode.AUTO,
        "How a target is solved. network: by the network alone, as in the paper; refined: the "
        "network's joint positions are refined on the forward kinematics inside the joint box; "
        "whole_robot: of an arm, anywhere within the joint limits, on the branch of the previous "
        "command; auto: network for the gantry, and for an arm the whole robot, or refined if its "
        "joint box is smaller than its limits.",
    )
    refinement: RefinementOptions = parameters_of(
        RefinementOptions, read_only=False, names={"tolerance": "refinement_tolerance"}
    )
    seed_from_previous: bool = changeable(
        False,
        "Start the refinement from the previous command where its pose is nearer to the target "
        "than that of the network's joint positions. true: a solution may depend on previous "
        "targets; false: on its target alone.",
    )
    search: SearchOptions = parameters_of(
        SearchOptions, read_only=False, names={"spacing": "solution_spacing"}
    )
    acceptance_limits: AcceptanceLimits = parameters_of(AcceptanceLimits, read_only=False)
    command_safety: CommandSafety = parameters_of(CommandSafety, read_only=False)
    measurement_timeout: float = changeable(
        0.5,
        "How long the measured position of a joint counts after its arrival.",
        unit="s",
        within=(1e-3, 3600.0),
    )
    transform_timeout: float = parameter(
        1.0,
        "How far from the present time the newest transform may be that takes a target from "
        "another frame to the base frame, where tf2_ros is installed. 0: none is taken.",
        unit="s",
        within=(0.0, 3600.0),
    )
    on_refusal: OnRefusal = changeable(
        OnRefusal.SILENT,
        "What is published for a refused target. silent: nothing; hold: the last command again, "
        "with a new stamp, for controllers that stop without one.",
    )
    publish_joint_trajectory: bool = changeable(
        False, "Publish each command on joint_trajectory too, as a trajectory of one point."
    )
    publish_position_commands: bool = changeable(
        False, "Publish each command on position_commands too."
    )
    trajectory_interval: float = changeable(
        0.1,
        "Time from one point of a trajectory to the next, and to the first.",
        unit="s",
        within=(1e-3, 1000.0),
    )
    solution_turns: bool = changeable(
        False,
        "solutions has every solution in all full turns that the joint limits allow, not only in "
        "the nearest one.",
    )
    max_path_poses: int = changeable(
        1000,
        "Most poses in target_poses, which bounds the time of its solution; other targets wait.",
        within=(1, 1_000_000),
    )
    queue_depth: int = parameter(
        1,
        "How many targets may wait while one is solved. 1: the newest replaces the one that "
        "waits, as a controller needs; more: none of a burst is dropped.",
        within=(1, 100_000),
    )
    autostart: bool = parameter(
        True, "true: configure and activate at the start; false: wait for lifecycle transitions."
    )
    executor: ExecutorChoice = parameter(
        ExecutorChoice.EVENTS,
        "The executor of rclpy. events: the events executor, which is faster; single_threaded: "
        "the default one.",
    )

    def solver(self, model: "Model") -> "IkSolver":
        """The solver that they describe, for a model."""
        # Not above: it loads slowly, and a node joins the others before.
        from annik_core.solver.ik_solver import IkSolver

        return IkSolver(
            model,
            self.acceptance_limits,
            self.mode,
            self.refinement,
            self.seed_from_previous,
            self.search,
        )
