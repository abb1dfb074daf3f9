"""The parameters of ``fake_robot``. Needs no ROS."""

from dataclasses import dataclass

from annik_core.errors import InvalidValue
from annik_core.robots.robot import Robot
from annik_core.simulation.imperfections import (
    LARGEST_SEED,
    ImperfectionMagnitudes,
    Imperfections,
    random_imperfections,
    read_imperfections,
)
from annik_ros.parameters import parameter, parameters_of


@dataclass(frozen=True)
class FakeRobotParameters:
    """Parameters of ``fake_robot``."""

    model: str = parameter(
        "",
        "Path of a model file, or name of a packaged model, whose robot to simulate; empty: see "
        "robot_description.",
    )
    robot_description: str = parameter(
        "", "Text of the URDF to simulate if there is no model; empty: see robot."
    )
    robot: str = parameter(
        "gantry",
        "Packaged robot, or path of a robot definition or URDF, to simulate if there is neither a "
        "model nor a robot_description.",
    )
    base_frame: str = parameter(
        "", "Of a URDF: the link that poses are relative to; empty: its root, or as defined."
    )
    end_effector_frame: str = parameter(
        "", "Of a URDF: the link whose pose is given; empty: its only tip, or as defined."
    )
    imperfections: str = parameter(
        "",
        "Path of a file with the errors of an imperfect arm, such as config/imperfect_ur5e.yaml; "
        "empty: see imperfection_seed.",
    )
    imperfection_seed: int = parameter(
        -1,
        "Seed of the random errors of an imperfect arm, uniform up to the magnitudes below, and "
        "of the noise of its measurements. One seed, one arm; -1: a perfect robot.",
        within=(-1, LARGEST_SEED),
    )
    magnitudes: ImperfectionMagnitudes = parameters_of(ImperfectionMagnitudes)
    joint_state_rate: float = parameter(
        50.0,
        "Rate of joint_states from the start on, besides one after each command. 0: only these.",
        unit="Hz",
        within=(0.0, 10_000.0),
    )
    publish_robot_description: bool = parameter(
        True, "false: no robot_description and no tf, since robot_state_publisher does it."
    )
    measurement_rate: float = parameter(
        0.0,
        "Rate of measured_pose, as of a tracker, and of joint_states with the same stamp. "
        "0: never.",
        unit="Hz",
        within=(0.0, 10_000.0),
    )

    def __post_init__(self) -> None:
        if self.imperfection_seed < 0:
            for name, default in vars(ImperfectionMagnitudes()).items():
                value = getattr(self.magnitudes, name)
                if value != default:
                    raise InvalidValue(name, value, f"{default:g} without imperfection_seed")
        elif self.imperfections:
            raise InvalidValue(
                "imperfection_seed",
                self.imperfection_seed,
                "-1 together with imperfections, a file that has them",
            )

    def robot_imperfections(self, robot: Robot) -> Imperfections | None:
        """The imperfections of the robot; None: a perfect robot.

        Raises:
            AnnikError: if the file or the robot can't be used.
        """
        if self.imperfections:
            return read_imperfections(self.imperfections, robot)
        if self.imperfection_seed < 0:
            return None
        return random_imperfections(robot, self.imperfection_seed, self.magnitudes)
