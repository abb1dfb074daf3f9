"""Settings of a collection: motion, waiting times, and which measurements are accepted."""

import math
from dataclasses import dataclass
from functools import cached_property

from annik_core.errors import InvalidValue
from annik_core.safety import CommandSafety
from annik_core.settings import check_settings, setting, upper_limit


@dataclass(frozen=True)
class CollectionSettings:
    """How a collector moves, waits, measures and gives up; see :func:`check_settings`."""

    command_rate: float = setting(
        100.0,
        "Commands per second, also while the robot stands still.",
        unit="Hz",
        within=(1.0, 1000.0),
    )
    max_joint_velocity: float = setting(
        0.5,
        "Velocity of the joint that moves furthest; the others arrive at the same time.",
        unit="rad/s or m/s",
        within=(1e-6, 1000.0),
    )
    max_joint_acceleration: float = setting(
        1.0,
        "Acceleration and deceleration of that joint.",
        unit="rad/s^2 or m/s^2",
        within=(1e-6, 100_000.0),
    )
    max_measured_step: float = upper_limit(
        0.2,
        "Largest distance of a measured joint from its command, and from its previous "
        "measurement; beyond it the node stops with exit code 1. From half of it on the motion "
        "slows down, so that the robot can catch up. Infinity: no limit.",
        unit="rad or m",
    )
    measurement_timeout: float = setting(
        0.5,
        "Longest time without joint_states; after it the node stops with exit code 1.",
        unit="s",
        within=(1e-3, 3600.0),
    )
    workspace_box_lower: tuple[float, ...] = setting(
        CommandSafety.workspace_box_lower,
        "Least x, y, z of the end effector in the base frame, by the forward kinematics, at the "
        "examples and on the way; an example that can't be reached inside the box is skipped.",
        unit="m",
        within=(-math.inf, math.inf),
    )
    workspace_box_upper: tuple[float, ...] = setting(
        CommandSafety.workspace_box_upper,
        "Greatest x, y, z, likewise.",
        unit="m",
        within=(-math.inf, math.inf),
    )
    settle_tolerance: float = setting(
        0.005,
        "The robot has arrived when no measured joint is further than this from its command.",
        unit="rad or m",
        greater_than=0.0,
        within=(None, 1000.0),
    )
    still_tolerance: float = setting(
        0.0005,
        "The robot stands still while no joint moves by more than this. Must exceed the noise of "
        "the encoders.",
        unit="rad or m",
        greater_than=0.0,
        within=(None, 1000.0),
    )
    settle_time: float = setting(
        0.5,
        "How long the robot must stand still before it is measured. Must exceed the latency of "
        "measured_pose, or poses of the motion are averaged too.",
        unit="s",
        within=(0.0, 3600.0),
    )
    settle_timeout: float = setting(
        10.0,
        "Longest wait for the robot to stand still; after it the example has failed for now. A "
        "robot that lags behind for this long stops the node. Longer than settle_time.",
        unit="s",
        within=(0.0, 3600.0),
    )
    samples: int = setting(
        10,
        "How many measured poses are averaged for an example. A journal keeps its number.",
        within=(1, 100_000),
    )
    pose_timeout: float = setting(
        5.0, "Longest wait for the samples of one measurement.", unit="s", within=(1e-3, 3600.0)
    )
    max_position_spread: float = upper_limit(
        0.005,
        "Largest distance of a sample from the mean; beyond it, or if one sample is an outlier, "
        "the measurement is repeated.",
        unit="m",
    )
    max_orientation_spread: float = upper_limit(
        0.05, "Largest angle of a sample from the mean, likewise.", unit="rad"
    )
    max_position_deviation: float = upper_limit(
        0.05,
        "Largest distance of the mean from the nominal forward kinematics; beyond it the "
        "measurement is repeated.",
        unit="m",
    )
    max_orientation_deviation: float = upper_limit(
        0.2, "Largest angle of the mean from the nominal forward kinematics, likewise.", unit="rad"
    )
    max_repeats: int = setting(
        3,
        "How often a measurement is repeated before its example has failed for now.",
        within=(0, 1000),
    )
    max_retries: int = setting(
        2, "How often a failed example is visited again, after all others.", within=(0, 1000)
    )
    max_failures_in_a_row: int = setting(
        5,
        "After this many failed examples in a row the node stops with exit code 1: the set-up is "
        "at fault.",
        within=(1, 1_000_000),
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if not self.settle_timeout > self.settle_time:
            raise InvalidValue(
                "settle_timeout", self.settle_timeout, f"more than settle_time, {self.settle_time}"
            )
        _ = self.command_safety

    @property
    def spacing(self) -> float:
        """Largest distance of a joint from one command to the next [rad or m]."""
        return self.max_joint_velocity / self.command_rate

    @cached_property
    def command_safety(self) -> CommandSafety:
        """The limits of every command."""
        return CommandSafety(
            workspace_box_lower=self.workspace_box_lower,
            workspace_box_upper=self.workspace_box_upper,
            max_measured_step=self.max_measured_step,
        )
