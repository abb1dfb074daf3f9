"""Kinematic errors and measurement noise of a simulated arm: data, files, random draws.

The error of a gear that comes again with every turn of its joint.

In what a real arm differs from its description, for a fake robot to be learned from.

Amounts are in metres and radians. The sign of each is that of its motion in
this module, whose four Denavit-Hartenberg kinds these are: a joint turns as
its URDF says, and lengths and twists count along the common normal from its axis to the next.

Imperfections from a YAML file.

Imperfections drawn from a seed: another robot for each, always the same for one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import yaml

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray
from annik_core.robots.arm import ArmKinematics
from annik_core.robots.corrected_kinematics import JointCorrectedKinematics
from annik_core.robots.corrections import JointCorrection
from annik_core.robots.kinematic_errors import ErrorKind, geometric_errors, placements_of
from annik_core.robots.robot import ForwardKinematics, Robot


@dataclass(frozen=True, eq=False)
class PeriodicTransmissionError(JointCorrection):
    """``actual = q + amplitude * sin(q + phase)``, each joint for itself.

    Attributes:
        amplitude: ``(dof,)`` [rad]; less than 1, or a joint would turn backwards.
        phase: ``(dof,)`` [rad].
    """

    amplitude: FloatArray
    phase: FloatArray

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        actual: FloatArray = joint_positions + self.amplitude * np.sin(
            joint_positions + self.phase
        )
        return actual

    def slopes(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        slopes: FloatArray = 1.0 + self.amplitude * np.cos(joint_positions + self.phase)
        return slopes


class InvalidImperfections(AnnikError):
    """Imperfections have an entry that is unknown or out of range, or can't be read."""

    def __init__(self, source: str, problem: str) -> None:
        self.source = source
        self.problem = problem
        super().__init__(f"imperfections {source}: {problem}")


class UnsupportedRobotForImperfections(AnnikError):
    """A robot whose kinematics annik can't make imperfect."""

    def __init__(self, robot: str, kind: str) -> None:
        self.robot = robot
        self.kind = kind
        super().__init__(
            f"{robot} is a {kind}, and only an arm can be imperfect: take an arm, such as ur5e, "
            "or leave the imperfections out"
        )


class Range(NamedTuple):
    """What an entry may be.

    Attributes:
        lower: least value.
        upper: greatest value.
        unit: of both; empty if it has none.
    """

    lower: float
    upper: float
    unit: str

    def check(self, value: object, what: str, source: str) -> float:
        """The value as a float.

        Args:
            value: as given.
            what: what to call the entry in an error.
            source: what to call the imperfections in an error.

        Raises:
            InvalidImperfections: naming the entry, its value and the range.
        """
        # True and false are numbers to Python; NaN is in no range.
        if (
            isinstance(value, (int, float))
            and value is not True
            and value is not False
            and self.lower <= value <= self.upper
        ):
            return float(value)
        unit = f" [{self.unit}]" if self.unit else ""
        remedy = "; give metres and radians" if self.unit else ""
        if isinstance(value, str):
            # What YAML makes of 20e-6.
            remedy += "; a number in YAML has a point before its exponent, such as 2.0e-5"
        raise InvalidImperfections(
            source,
            f"{what} is {value!r}; it must be a number from {self.lower:g} to "
            f"{self.upper:g}{unit}{remedy}",
        )


#: Larger errors are another robot: millimetres or degrees that were taken for metres or radians.
LARGEST_ANGLE: Final = 0.2
LARGEST_LENGTH: Final = 0.1
_ANGLE: Final = Range(-LARGEST_ANGLE, LARGEST_ANGLE, "rad")
_LENGTH: Final = Range(-LARGEST_LENGTH, LARGEST_LENGTH, "m")

#: What each joint has: entry and what it may be.
JOINT_ENTRIES: Final[dict[str, Range]] = {
    "joint_zero": _ANGLE,
    "joint_offset": _LENGTH,
    "link_length": _LENGTH,
    "link_twist": _ANGLE,
    "transmission_amplitude": Range(0.0, LARGEST_ANGLE, "rad"),
    "transmission_phase": Range(-2.0 * math.pi, 2.0 * math.pi, "rad"),
    "backlash": Range(0.0, LARGEST_LENGTH, "rad or m"),
}
#: What a measured pose has.
MEASUREMENT_ENTRIES: Final[dict[str, Range]] = {
    "position_noise": Range(0.0, LARGEST_LENGTH, "m"),
    "orientation_noise": Range(0.0, LARGEST_ANGLE, "rad"),
    "dropped": Range(0.0, 1.0, ""),
}
#: The largest seed, of noise and of imperfections to draw.
LARGEST_SEED: Final = 2**31 - 1

_GEOMETRY: Final = {
    ErrorKind.JOINT_ZERO: "joint_zero",
    ErrorKind.JOINT_OFFSET: "joint_offset",
    ErrorKind.LINK_LENGTH: "link_length",
    ErrorKind.LINK_TWIST: "link_twist",
}


# Its numbers are not for those who are to learn them: no log prints them by accident.
@dataclass(frozen=True, eq=False, repr=False)
class Imperfections:
    """The errors of an arm and of the measurements of its pose; by default there are none.

    Attributes:
        joint_zero: ``(dof,)`` errors of the joints' zeros: motions about their axes [rad].
        joint_offset: ``(dof,)`` errors along the joints' axes [m].
        link_length: ``(dof,)`` errors of the links' lengths, after each joint [m].
        link_twist: ``(dof,)`` errors of the links' twists, after each joint [rad].
        transmission_amplitude: ``(dof,)`` see :class:`PeriodicTransmissionError` [rad].
        transmission_phase: ``(dof,)`` [rad].
        backlash: ``(dof,)`` how far each joint can move while its drive stands still [rad or m].
        position_noise: standard deviation of a measured position, per axis [m].
        orientation_noise: standard deviation of a measured orientation, about each axis [rad].
        dropped: probability that a measurement is not reported.
        noise_seed: what noise and lost measurements are drawn from.
    """

    joint_zero: FloatArray
    joint_offset: FloatArray
    link_length: FloatArray
    link_twist: FloatArray
    transmission_amplitude: FloatArray
    transmission_phase: FloatArray
    backlash: FloatArray
    position_noise: float = 0.0
    orientation_noise: float = 0.0
    dropped: float = 0.0
    noise_seed: int = 0

    def __post_init__(self) -> None:
        """Check all entries; the arrays become read-only copies.

        Raises:
            InvalidImperfections: naming the entry, its value and what is allowed.
        """
        source = "given"
        dof = np.size(self.joint_zero)
        for name, allowed in JOINT_ENTRIES.items():
            given = np.asarray(getattr(self, name))
            if given.shape != (dof,):
                raise InvalidImperfections(
                    source, f"{name} has shape {given.shape}, not ({dof},), one per joint"
                )
            checked = [
                allowed.check(value, f"{name} of joint {number}", source)
                for number, value in enumerate(given.tolist(), 1)
            ]
            array = np.array(checked)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name, allowed in MEASUREMENT_ENTRIES.items():
            object.__setattr__(self, name, allowed.check(getattr(self, name), name, source))
        check_seed(self.noise_seed, "noise_seed", source)

    @classmethod
    def none(cls, dof: int) -> Imperfections:
        """Those of a perfect arm with ``dof`` joints."""
        perfect: dict[str, Any] = {name: np.zeros(dof) for name in JOINT_ENTRIES}
        return cls(**perfect)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_zero)

    def measurement_generator(self) -> np.random.Generator:
        """What draws the noise of measurements; always the same sequence."""
        # Not the sequence that drew the imperfections themselves from the same seed.
        return np.random.default_rng([self.noise_seed, 1])

    def as_plain_data(self, joint_names: tuple[str, ...]) -> dict[str, Any]:
        """What a file holds; see :func:`read_imperfections`."""
        joints = {
            joint: {name: float(getattr(self, name)[index]) for name in JOINT_ENTRIES}
            for index, joint in enumerate(joint_names)
        }
        others = {
            entry.name: getattr(self, entry.name)
            for entry in fields(self)
            if entry.name not in JOINT_ENTRIES
        }
        return {"joints": joints, **others}


def check_seed(seed: object, what: str, source: str) -> int:
    """A seed that every generator takes.

    Raises:
        InvalidImperfections: if it is anything else.
    """
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed <= LARGEST_SEED:
        raise InvalidImperfections(
            source, f"{what} is {seed!r}; it must be an integer from 0 to {LARGEST_SEED}"
        )
    return seed


def check_arm(robot: Robot) -> None:
    """Refuse a robot that can't be imperfect.

    Raises:
        UnsupportedRobotForImperfections: if it is not an arm.
    """
    if robot.kind != "arm":
        raise UnsupportedRobotForImperfections(robot.name, robot.kind)


def check_fit(imperfections: Imperfections, robot: Robot, source: str) -> None:
    """Refuse imperfections that can't be those of this robot.

    Raises:
        InvalidImperfections: if they are for another number of joints, or a joint that shifts has
            a transmission error, which is one of turning gears.
        UnsupportedRobotForImperfections: if it is not an arm.
    """
    check_arm(robot)
    if imperfections.dof != robot.dof:
        raise InvalidImperfections(
            source, f"they are for {imperfections.dof} joints; {robot.name} has {robot.dof}"
        )
    for joint, kind, amplitude in zip(
        robot.joint_names, robot.joint_types, imperfections.transmission_amplitude, strict=True
    ):
        if kind == "prismatic" and amplitude > 0.0:
            raise InvalidImperfections(
                source,
                f"transmission_amplitude of {joint} is {amplitude:g}; it must be 0, since the "
                "joint shifts",
            )


def imperfect_kinematics(robot: Robot, imperfections: Imperfections) -> ForwardKinematics:
    """Where the real end effector is, given the commanded joint positions; without backlash.

    Args:
        robot: the arm as described. Corrections that it has learned change nothing: the real one
            is where it is.
        imperfections: of the real one.

    Raises:
        InvalidImperfections: if they can't be those of this robot.
        MissingDependency: if Pinocchio is not installed.
        UnsupportedRobotForImperfections: if it is not an arm.
    """
    check_fit(imperfections, robot, "given")
    nominal = ArmKinematics(robot.joint_names, robot.definition["urdf"], robot.end_effector_frame)
    errors = [error for error in geometric_errors(nominal) if error.kind in _GEOMETRY]
    amounts = [
        float(getattr(imperfections, _GEOMETRY[error.kind])[error.place - 1]) for error in errors
    ]
    return JointCorrectedKinematics(
        ArmKinematics(
            nominal.joint_names,
            nominal.urdf,
            nominal.end_effector_frame,
            placements_of(errors, amounts, robot.dof),
        ),
        PeriodicTransmissionError(
            imperfections.transmission_amplitude, imperfections.transmission_phase
        ),
    )


def read_imperfections(path: str | Path, robot: Robot) -> Imperfections:
    """The imperfections of an arm that a file describes, in metres and radians.

    Args:
        path: a YAML file. ``joints`` maps names of joints to what is wrong with each:
            ``joint_zero``, ``joint_offset``, ``link_length``, ``link_twist``,
            ``transmission_amplitude``, ``transmission_phase`` and ``backlash``; beside it are
            ``position_noise``, ``orientation_noise``, ``dropped`` and ``noise_seed``. Their
            meaning is in :class:`Imperfections`; what is left out is 0.
        robot: the arm.

    Raises:
        InvalidImperfections: if the file can't be read, or naming the entry that is wrong.
        UnsupportedRobotForImperfections: if the robot is not an arm.
    """
    check_arm(robot)
    source = str(path)
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InvalidImperfections(source, "there is no such file: check the path") from error
    except (OSError, ValueError) as error:
        raise InvalidImperfections(source, f"can't be read: {error}") from error
    try:
        data = yaml.safe_load(text)
    # Besides YAMLError, PyYAML lets through whatever an ill-formed date or tag runs into.
    except Exception as error:
        raise InvalidImperfections(source, f"not readable as YAML: {error}") from error
    return imperfections_from_plain_data(data, robot, source)


def imperfections_from_plain_data(data: Any, robot: Robot, source: str) -> Imperfections:
    """The content of such a file; the reverse of :meth:`Imperfections.as_plain_data`.

    Args:
        data: as read.
        robot: the arm.
        source: what to call the file in an error.

    Raises:
        InvalidImperfections: naming the entry that is wrong.
    """
    _check_entries(data, "the file", ("joints", *MEASUREMENT_ENTRIES, "noise_seed"), source)
    joints = data.get("joints", {})
    _check_entries(joints, "joints", robot.joint_names, source)
    attributes: dict[str, Any] = {name: np.zeros(robot.dof) for name in JOINT_ENTRIES}
    for joint, entries in joints.items():
        _check_entries(entries, f"joints.{joint}", JOINT_ENTRIES, source)
        index = robot.joint_names.index(joint)
        for name, value in entries.items():
            what = f"joints.{joint}.{name}"
            attributes[name][index] = JOINT_ENTRIES[name].check(value, what, source)
    for name, allowed in MEASUREMENT_ENTRIES.items():
        attributes[name] = allowed.check(data.get(name, 0.0), name, source)
    attributes["noise_seed"] = check_seed(data.get("noise_seed", 0), "noise_seed", source)
    imperfections = Imperfections(**attributes)
    check_fit(imperfections, robot, source)
    return imperfections


def _check_entries(data: object, what: str, known: Collection[str], source: str) -> None:
    """Refuse what is no mapping, or has a key of another name."""
    names = ", ".join(known)
    if not isinstance(data, Mapping):
        raise InvalidImperfections(source, f"{what} is not a mapping; its keys are {names}")
    for key in data:
        if key not in known:
            raise InvalidImperfections(
                source, f"{what} has the key {key!r}, which is unknown; its keys are {names}"
            )


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
