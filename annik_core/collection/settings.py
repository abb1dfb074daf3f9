"""How examples are collected on a robot: speeds, waits, and what is believed."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property

from annik_core.collection.errors import InvalidCollectionSetting
from annik_core.safety import CommandSafety


@dataclass(frozen=True)
class CollectionSettings:
    """How a collector drives, waits, measures and gives up.

    Attributes:
        command_rate: commands per second [Hz].
        max_joint_velocity: of every joint [rad/s or m/s].
        max_joint_acceleration: of every joint [rad/s^2 or m/s^2].
        max_measured_step: largest distance of a measured joint from its command, and from where
            it was measured before [rad or m]. From half of it on the motion slows down.
        measurement_timeout: longest silence of the joint states [s].
        workspace_box_lower: least x, y, z of the end effector in the base frame [m].
        workspace_box_upper: greatest x, y, z [m].
        settle_tolerance: how near to its command a joint comes to rest [rad or m].
        still_tolerance: how far a joint may move while it is said to stand still [rad or m].
        settle_time: how long it stands still before it is measured [s].
        settle_timeout: longest wait for that, and for a robot that lags behind [s]; longer than
            settle_time.
        samples: measured poses that are averaged for an example.
        pose_timeout: longest wait for the samples of one measurement [s].
        max_position_spread: largest distance of a sample from the mean [m].
        max_orientation_spread: largest angle of a sample from the mean [rad].
        max_position_deviation: largest distance of the mean from the nominal forward kinematics
            [m].
        max_orientation_deviation: largest angle, likewise [rad].
        max_repeats: how often a measurement is repeated before its example has failed.
        max_retries: how often an example that failed is driven to again, after all others.
        max_failures_in_a_row: of examples, before the collection stops; more point to a fault of
            the set-up.

    Raises:
        InvalidCollectionSetting: if a number is not positive where it must be, or not finite.
        InvalidSafetyLimit: if the workspace box is empty.
    """

    command_rate: float = 100.0
    max_joint_velocity: float = 0.5
    max_joint_acceleration: float = 1.0
    max_measured_step: float = 0.2
    measurement_timeout: float = 0.5
    workspace_box_lower: tuple[float, ...] = CommandSafety.workspace_box_lower
    workspace_box_upper: tuple[float, ...] = CommandSafety.workspace_box_upper
    settle_tolerance: float = 0.005
    still_tolerance: float = 0.0005
    settle_time: float = 0.5
    settle_timeout: float = 10.0
    samples: int = 10
    pose_timeout: float = 5.0
    max_position_spread: float = 0.005
    max_orientation_spread: float = 0.05
    max_position_deviation: float = 0.05
    max_orientation_deviation: float = 0.2
    max_repeats: int = 3
    max_retries: int = 2
    max_failures_in_a_row: int = 5

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        if not self.max_measured_step > 0.0:
            raise InvalidCollectionSetting(
                "max_measured_step", self.max_measured_step, "more than 0"
            )
        for name in ("command_rate", "max_joint_velocity", "max_joint_acceleration"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise InvalidCollectionSetting(name, value, "more than 0, and finite")
        for name in ("samples", "max_failures_in_a_row"):
            if getattr(self, name) < 1:
                raise InvalidCollectionSetting(name, getattr(self, name), "1 or more")
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, tuple) and not value >= 0:
                raise InvalidCollectionSetting(field.name, value, "0 or more")
        if not self.settle_timeout > self.settle_time:
            raise InvalidCollectionSetting(
                "settle_timeout", self.settle_timeout, f"more than settle_time, {self.settle_time}"
            )
        _ = self.command_safety

    @property
    def spacing(self) -> float:
        """How far a joint moves from one command to the next at most [rad or m]."""
        return self.max_joint_velocity / self.command_rate

    @cached_property
    def command_safety(self) -> CommandSafety:
        """What every command is held to."""
        return CommandSafety(
            workspace_box_lower=self.workspace_box_lower,
            workspace_box_upper=self.workspace_box_upper,
            max_measured_step=self.max_measured_step,
        )
