"""Imperfections drawn from a seed: another robot for each, always the same for one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from annik_core.imperfections import (
    JOINT_ENTRIES,
    MEASUREMENT_ENTRIES,
    Imperfections,
    Range,
    check_arm,
    check_seed,
)
from annik_core.robot import Robot

#: The entry of a joint or of a measurement that each magnitude is of.
_ENTRY_OF: Final = {
    "joint_zero_error": "joint_zero",
    "link_length_error": "link_length",
    "link_twist_error": "link_twist",
    "transmission_error": "transmission_amplitude",
    "backlash": "backlash",
    "position_noise": "position_noise",
    "orientation_noise": "orientation_noise",
    "dropped_measurements": "dropped",
}
_ENTRIES: Final = {**JOINT_ENTRIES, **MEASUREMENT_ENTRIES}

#: What each magnitude may be.
MAGNITUDES: Final[dict[str, Range]] = {
    name: Range(0.0, _ENTRIES[entry].upper, _ENTRIES[entry].unit)
    for name, entry in _ENTRY_OF.items()
}


@dataclass(frozen=True)
class ImperfectionMagnitudes:
    """How large drawn imperfections are; by default about those of an arm as delivered.

    Attributes:
        joint_zero_error: largest error of a joint's zero [rad].
        link_length_error: largest error of a link's length and of a joint's offset [m].
        link_twist_error: largest error of a link's twist [rad].
        transmission_error: largest amplitude of the periodic error of a joint that turns [rad].
        backlash: largest backlash of a joint [rad or m].
        position_noise: standard deviation of a measured position, per axis [m].
        orientation_noise: standard deviation of a measured orientation, about each axis [rad].
        dropped_measurements: probability that a measurement is not reported.
    """

    joint_zero_error: float = math.radians(0.5)
    link_length_error: float = 1e-3
    link_twist_error: float = math.radians(0.3)
    transmission_error: float = math.radians(0.2)
    backlash: float = 0.0
    position_noise: float = 20e-6
    orientation_noise: float = math.radians(0.002)
    dropped_measurements: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is out of range.

        Raises:
            InvalidImperfections: naming the magnitude, its value and what is allowed.
        """
        for name, allowed in MAGNITUDES.items():
            allowed.check(getattr(self, name), name, "to draw")


def drawn_imperfections(
    robot: Robot, seed: int, magnitudes: ImperfectionMagnitudes | None = None
) -> Imperfections:
    """The imperfections that a seed gives an arm, each uniformly within its magnitude.

    To change one magnitude leaves what is drawn for the others as it is.

    Args:
        robot: the arm; the number and types of its joints count.
        seed: from 0 on.
        magnitudes: how large; None: as by default.

    Raises:
        InvalidImperfections: if the seed is out of range.
        UnsupportedRobotForImperfections: if the robot is not an arm.
    """
    check_arm(robot)
    check_seed(seed, "the seed", "to draw")
    magnitudes = magnitudes or ImperfectionMagnitudes()
    rng = np.random.default_rng(seed)
    # Rows beyond these belong after them, or the same seeds would give other robots.
    zero, offset, length, twist = rng.uniform(-1.0, 1.0, (4, robot.dof))
    amplitude, phase, backlash = rng.uniform(0.0, 1.0, (3, robot.dof))
    turns = np.array([kind == "revolute" for kind in robot.joint_types])
    return Imperfections(
        joint_zero=magnitudes.joint_zero_error * zero,
        joint_offset=magnitudes.link_length_error * offset,
        link_length=magnitudes.link_length_error * length,
        link_twist=magnitudes.link_twist_error * twist,
        transmission_amplitude=magnitudes.transmission_error * amplitude * turns,
        transmission_phase=2.0 * math.pi * phase,
        backlash=magnitudes.backlash * backlash,
        position_noise=magnitudes.position_noise,
        orientation_noise=magnitudes.orientation_noise,
        dropped=magnitudes.dropped_measurements,
        noise_seed=seed,
    )
