"""The parameters of ``example_collector``. Needs no ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path

from annik_core.collection.settings import CollectionSettings
from annik_ros.parameters import SMALLEST_LIMIT, InvalidParameter, parameter


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
        "before; beyond it the node stops, with exit code 1. From half of it on the motion slows "
        "down, so that the robot can catch up. Infinite: no limit.",
        unit="rad or m",
        minimum=SMALLEST_LIMIT,
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
        "The robot is where it was told to be while no measured joint is further than this from "
        "its command.",
        unit="rad or m",
        minimum=SMALLEST_LIMIT,
        maximum=1000.0,
    )
    still_tolerance: float = parameter(
        CollectionSettings.still_tolerance,
        "It stands still while no joint moves by more than this; more than the encoders' noise.",
        unit="rad or m",
        minimum=SMALLEST_LIMIT,
        maximum=1000.0,
    )
    settle_time: float = parameter(
        CollectionSettings.settle_time,
        "How long it stands still before it is measured. Longer than measured_pose is late, or "
        "poses from before are averaged too.",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    settle_timeout: float = parameter(
        CollectionSettings.settle_timeout,
        "An example at which the robot does not stand still after this time has failed for now; a "
        "robot that does not catch up in this time stops the node.",
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
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_orientation_spread: float = parameter(
        CollectionSettings.max_orientation_spread,
        "Largest angle of a sample from the mean, likewise.",
        unit="rad",
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_position_deviation: float = parameter(
        CollectionSettings.max_position_deviation,
        "Largest distance of the mean from the nominal forward kinematics; beyond it, it is "
        "measured again.",
        unit="m",
        minimum=SMALLEST_LIMIT,
        maximum=math.inf,
    )
    max_orientation_deviation: float = parameter(
        CollectionSettings.max_orientation_deviation,
        "Largest angle of the mean from the nominal forward kinematics, likewise.",
        unit="rad",
        minimum=SMALLEST_LIMIT,
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
