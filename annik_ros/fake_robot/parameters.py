"""The parameters of ``fake_robot``. Needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from annik_core.robots.robot import Robot
from annik_core.simulation.imperfections import (
    LARGEST_SEED,
    MAGNITUDES,
    ImperfectionMagnitudes,
    Imperfections,
    drawn_imperfections,
    read_imperfections,
)
from annik_ros.parameters import InvalidParameter, parameter


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
