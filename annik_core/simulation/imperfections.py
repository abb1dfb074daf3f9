"""Kinematic errors and measurement noise of a simulated arm: values, files, random draws.

In metres and radians. The kinematic errors are the four Denavit-Hartenberg kinds of
:mod:`annik_core.robots.kinematic_errors`: a joint moves as its URDF says, and lengths and twists
are along and about the common normal from its axis to the next.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from annik_core.errors import AnnikError, InvalidValue
from annik_core.files import bounded_yaml, read_text
from annik_core.pose import FloatArray
from annik_core.robots.arm_kinematics import JointCorrectedKinematics, arm_kinematics
from annik_core.robots.corrections import (
    ArmCorrections,
    Deflection,
    JointCorrection,
    diagonal,
)
from annik_core.robots.kinematic_errors import ErrorKind, geometric_errors, placements_of
from annik_core.robots.robot import ForwardKinematics, Robot
from annik_core.robots.screw_chain import ScrewChain
from annik_core.settings import CheckedSettings, Setting, check_settings, setting, settings_of


@dataclass(frozen=True, eq=False)
class PeriodicTransmissionError(JointCorrection):
    """``actual = q + amplitude * sin(q + phase)``, each joint for itself, arrays ``(dof,)`` [rad].

    The amplitude is less than 1, or a joint would turn backwards.
    """

    amplitude: FloatArray
    phase: FloatArray

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        actual: FloatArray = joint_positions + self.amplitude * np.sin(
            joint_positions + self.phase
        )
        return actual

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`annik_core.robots.corrections.JointCorrection`."""
        return diagonal(1.0 + self.amplitude * np.cos(joint_positions + self.phase))


class InvalidImperfections(AnnikError):
    """Imperfections can't be read, have an unknown key, or do not fit the robot."""

    def __init__(self, source: str, problem: str) -> None:
        self.source = source
        self.problem = problem
        super().__init__(f"imperfections {source}: {problem}")


#: Larger errors are rather millimetres or degrees, given as metres or radians.
LARGEST_ANGLE: Final = 0.2
LARGEST_LENGTH: Final = 0.1
#: Softer joints [rad/(N m)] and heavier links [kg] are rather a mistake in units.
LARGEST_COMPLIANCE: Final = 1e-3
LARGEST_MASS: Final = 1000.0
#: Acceleration of gravity [m/s^2], and its direction in the base frame of an arm on the floor.
GRAVITY: Final = 9.81
DOWN: Final = (0.0, 0.0, -1.0)
#: The largest seed of random errors and of noise.
LARGEST_SEED: Final = 2**31 - 1


#: The errors of each joint, by name.
JOINT_ENTRIES: Final = {
    name: Setting(name, 0.0, description, unit, minimum=lower, maximum=upper)
    for name, description, unit, lower, upper in (
        ("joint_zero", "Motion about the axis.", "rad", -LARGEST_ANGLE, LARGEST_ANGLE),
        ("joint_offset", "Along the axis.", "m", -LARGEST_LENGTH, LARGEST_LENGTH),
        ("link_length", "Of the link after it.", "m", -LARGEST_LENGTH, LARGEST_LENGTH),
        ("link_twist", "Of the link after it.", "rad", -LARGEST_ANGLE, LARGEST_ANGLE),
        ("transmission_amplitude", "Of the periodic error.", "rad", 0.0, LARGEST_ANGLE),
        ("transmission_phase", "Of the periodic error.", "rad", -2.0 * math.pi, 2.0 * math.pi),
        ("backlash", "Motion while its drive stands still.", "rad or m", 0.0, LARGEST_LENGTH),
        (
            "compliance",
            "Turn under the moment of gravity about its axis.",
            "rad/(N m)",
            0.0,
            LARGEST_COMPLIANCE,
        ),
        ("link_mass", "Of the link after it, all of it at its end.", "kg", 0.0, LARGEST_MASS),
    )
}

_GEOMETRY: Final = {
    ErrorKind.JOINT_ZERO: "joint_zero",
    ErrorKind.JOINT_OFFSET: "joint_offset",
    ErrorKind.LINK_LENGTH: "link_length",
    ErrorKind.LINK_TWIST: "link_twist",
}


# Without a repr, so that no log reveals to a calibration what it is to find.
@dataclass(frozen=True, eq=False, repr=False)
class Imperfections:
    """The errors of an arm and of the measurements of its pose.

    Attributes:
        joint_zero: see :data:`JOINT_ENTRIES`; this and all other arrays are ``(dof,)``.

    Raises:
        InvalidImperfections: if an array has another shape.
        InvalidValue: naming the entry, its value and what is allowed.
    """

    joint_zero: FloatArray
    joint_offset: FloatArray
    link_length: FloatArray
    link_twist: FloatArray
    transmission_amplitude: FloatArray
    transmission_phase: FloatArray
    backlash: FloatArray
    compliance: FloatArray
    link_mass: FloatArray
    position_noise: float = setting(
        0.0,
        "Standard deviation of a measured position along each axis.",
        unit="m",
        within=(0.0, LARGEST_LENGTH),
    )
    orientation_noise: float = setting(
        0.0,
        "Standard deviation of a measured orientation about each axis.",
        unit="rad",
        within=(0.0, LARGEST_ANGLE),
    )
    dropped: float = setting(0.0, "Probability that a measurement is lost.", within=(0.0, 1.0))
    noise_seed: int = setting(0, "Seed of noise and lost measurements.", within=(0, LARGEST_SEED))

    def __post_init__(self) -> None:
        dof = np.size(self.joint_zero)
        for name, entry in JOINT_ENTRIES.items():
            given = np.asarray(getattr(self, name))
            if given.shape != (dof,):
                raise InvalidImperfections(
                    "given", f"{name} has shape {given.shape}, not ({dof},), one per joint"
                )
            array = np.array(
                [
                    replace(entry, name=f"{name} of joint {number}").checked(value)
                    for number, value in enumerate(given.tolist(), 1)
                ]
            )
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        check_settings(self)

    @classmethod
    def none(cls, dof: int) -> "Imperfections":
        """Those of a perfect arm with ``dof`` joints."""
        perfect: dict[str, Any] = {name: np.zeros(dof) for name in JOINT_ENTRIES}
        return cls(**perfect)

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_zero)

    def measurement_generator(self) -> np.random.Generator:
        """The random generator of measurement noise; always the same sequence."""
        # Not the sequence that drew the imperfections themselves from the same seed.
        return np.random.default_rng([self.noise_seed, 1])

    def to_dict(self, joint_names: tuple[str, ...]) -> dict[str, Any]:
        """The content of a file; see :func:`read_imperfections`."""
        joints = {
            joint: {name: float(getattr(self, name)[index]) for name in JOINT_ENTRIES}
            for index, joint in enumerate(joint_names)
        }
        others = {entry.name: getattr(self, entry.name) for entry in settings_of(type(self))}
        return {"joints": joints, **others}


def check_arm(robot: Robot) -> None:
    """Refuse a robot that is not an arm, as :class:`InvalidImperfections`."""
    if robot.kind != "arm":
        raise InvalidImperfections(
            f"of {robot.name}",
            f"it is a {robot.kind}, and only an arm can be imperfect: choose an arm, such as "
            "ur5e, or omit the imperfections",
        )


def check_fit(imperfections: Imperfections, robot: Robot, source: str) -> None:
    """Refuse imperfections that do not fit a robot.

    Raises:
        InvalidImperfections: if the robot is not an arm or has another number of joints, or a
            prismatic joint has what only a joint that turns can have.
    """
    check_arm(robot)
    if imperfections.dof != robot.dof:
        raise InvalidImperfections(
            source, f"they are for {imperfections.dof} joints; {robot.name} has {robot.dof}"
        )
    for name in ("transmission_amplitude", "compliance"):
        values = getattr(imperfections, name).tolist()
        for joint, kind, value in zip(robot.joint_names, robot.joint_types, values, strict=True):
            if kind == "prismatic" and value > 0.0:
                raise InvalidImperfections(
                    source,
                    f"{name} of {joint} is {value:g}; it must be 0, since the joint is prismatic",
                )


def imperfect_kinematics(robot: Robot, imperfections: Imperfections) -> ForwardKinematics:
    """The forward kinematics of the real arm, without backlash or corrections of a calibration.

    Raises:
        InvalidImperfections: if they do not fit the robot.
    """
    check_fit(imperfections, robot, "given")
    errors = [error for error in geometric_errors(robot) if error.kind in _GEOMETRY]
    amounts = [
        float(getattr(imperfections, _GEOMETRY[error.kind])[error.place - 1]) for error in errors
    ]
    return JointCorrectedKinematics(
        arm_kinematics(
            robot.joint_names,
            ScrewChain.from_urdf(robot.definition["urdf"]),
            ArmCorrections(
                placements_of(errors, amounts, robot.dof), deflection=_deflection(imperfections)
            ),
        ),
        PeriodicTransmissionError(
            imperfections.transmission_amplitude, imperfections.transmission_phase
        ),
    )


def _deflection(imperfections: Imperfections) -> Deflection | None:
    """How the joints turn under the weight of the links; None: not at all."""
    weights = GRAVITY * imperfections.link_mass
    turns_per_lever = np.outer(imperfections.compliance, weights)
    return Deflection(turns_per_lever, np.array(DOWN)) if turns_per_lever.any() else None


def read_imperfections(path: str | Path, robot: Robot) -> Imperfections:
    """The imperfections of an arm from a YAML file, in metres and radians.

    ``joints`` maps names of joints to mappings with keys of :data:`JOINT_ENTRIES`; beside it are
    ``position_noise``, ``orientation_noise``, ``dropped`` and ``noise_seed`` of
    :class:`Imperfections`. Missing keys mean 0.

    Raises:
        InvalidImperfections: if the file can't be read, an entry is wrong, or the robot is not
            an arm.
    """
    check_arm(robot)
    source = str(path)
    try:
        text = read_text(path)
    except FileNotFoundError as error:
        raise InvalidImperfections(source, "file not found: check the path") from error
    except (OSError, ValueError) as error:
        raise InvalidImperfections(source, f"can't be read: {error}") from error
    try:
        data = bounded_yaml(text)
    except ValueError as error:
        raise InvalidImperfections(source, f"not readable as YAML: {error}") from error
    return imperfections_from_dict(data, robot, source)


def imperfections_from_dict(data: Any, robot: Robot, source: str) -> Imperfections:
    """The reverse of :meth:`Imperfections.to_dict`; errors call the data ``source``.

    Raises:
        InvalidImperfections: as :func:`read_imperfections`.
    """
    check_arm(robot)
    others = {entry.name: entry for entry in settings_of(Imperfections)}
    _check_keys(data, "the file", ("joints", *others), source)
    joints = data.get("joints", {})
    _check_keys(joints, "joints", robot.joint_names, source)
    attributes: dict[str, Any] = {name: np.zeros(robot.dof) for name in JOINT_ENTRIES}
    for joint, entries in joints.items():
        _check_keys(entries, f"joints.{joint}", JOINT_ENTRIES, source)
        index = robot.joint_names.index(joint)
        for name, value in entries.items():
            entry = replace(JOINT_ENTRIES[name], name=f"joints.{joint}.{name}")
            attributes[name][index] = _checked(entry, value, source)
    for name, entry in others.items():
        attributes[name] = _checked(entry, data.get(name, entry.default), source)
    imperfections = Imperfections(**attributes)
    check_fit(imperfections, robot, source)
    return imperfections


def _checked(entry: Setting, value: object, source: str) -> float:
    try:
        number: float = entry.checked(value)
    except InvalidValue as error:
        # YAML reads 20e-6 as a string.
        hint = "; write 2.0e-5, not 2e-5" if isinstance(value, str) else ""
        raise InvalidImperfections(source, f"{error}{hint}") from error
    return number


def _check_keys(data: object, what: str, known: Collection[str], source: str) -> None:
    names = ", ".join(known)
    if not isinstance(data, Mapping):
        raise InvalidImperfections(source, f"{what} is not a mapping; its keys are {names}")
    for key in data:
        if key not in known:
            raise InvalidImperfections(
                source, f"{what} has the key {key!r}, which is unknown; its keys are {names}"
            )


@dataclass(frozen=True)
class ImperfectionMagnitudes(CheckedSettings):
    """Magnitudes of random imperfections; by default about those of an arm as delivered."""

    joint_zero_error: float = setting(
        math.radians(0.5),
        "Largest random error of the zero of a joint.",
        unit="rad",
        within=(0.0, LARGEST_ANGLE),
    )
    link_length_error: float = setting(
        1e-3,
        "Largest random error of the length of a link, and of the offset of a joint along its "
        "axis.",
        unit="m",
        within=(0.0, LARGEST_LENGTH),
    )
    link_twist_error: float = setting(
        math.radians(0.3),
        "Largest random error of the twist of a link.",
        unit="rad",
        within=(0.0, LARGEST_ANGLE),
    )
    transmission_error: float = setting(
        math.radians(0.2),
        "Largest random amplitude of the periodic transmission error of a revolute joint.",
        unit="rad",
        within=(0.0, LARGEST_ANGLE),
    )
    backlash: float = setting(
        0.0, "Largest random backlash of a joint.", unit="rad or m", within=(0.0, LARGEST_LENGTH)
    )
    joint_compliance: float = setting(
        0.0,
        "Largest random turn of a revolute joint under a moment of gravity of 1 N m; the arm "
        "stands on a floor.",
        unit="rad/(N m)",
        within=(0.0, LARGEST_COMPLIANCE),
    )
    link_mass: float = setting(
        5.0,
        "Largest random mass of a link, all of it at its end; without joint_compliance it has no "
        "effect.",
        unit="kg",
        within=(0.0, LARGEST_MASS),
    )
    position_noise: float = setting(
        20e-6,
        "Standard deviation of a measured position along each axis.",
        unit="m",
        within=(0.0, LARGEST_LENGTH),
    )
    orientation_noise: float = setting(
        math.radians(0.002),
        "Standard deviation of a measured orientation about each axis.",
        unit="rad",
        within=(0.0, LARGEST_ANGLE),
    )
    dropped_measurements: float = setting(
        0.0, "Probability that a measurement is lost.", within=(0.0, 1.0)
    )


def random_imperfections(
    robot: Robot, seed: int, magnitudes: ImperfectionMagnitudes | None = None
) -> Imperfections:
    """Random imperfections of an arm, reproducible by seed, each uniform within its magnitude.

    Changing one magnitude leaves the random draws of the others as they are.

    Raises:
        InvalidImperfections: if the robot is not an arm.
        InvalidValue: if the seed is not from 0 to :data:`LARGEST_SEED`.
    """
    check_arm(robot)
    seed = Setting("seed", 0, "", minimum=0, maximum=LARGEST_SEED).checked(seed)
    magnitudes = magnitudes or ImperfectionMagnitudes()
    rng = np.random.default_rng(seed)
    # Further rows must follow these, or the same seeds would give other robots.
    zero, offset, length, twist = rng.uniform(-1.0, 1.0, (4, robot.dof))
    amplitude, phase, backlash = rng.uniform(0.0, 1.0, (3, robot.dof))
    compliance, mass = rng.uniform(0.0, 1.0, (2, robot.dof))
    turns = robot.rotary
    return Imperfections(
        joint_zero=magnitudes.joint_zero_error * zero,
        joint_offset=magnitudes.link_length_error * offset,
        link_length=magnitudes.link_length_error * length,
        link_twist=magnitudes.link_twist_error * twist,
        transmission_amplitude=magnitudes.transmission_error * amplitude * turns,
        transmission_phase=2.0 * math.pi * phase,
        backlash=magnitudes.backlash * backlash,
        compliance=magnitudes.joint_compliance * compliance * turns,
        link_mass=magnitudes.link_mass * mass,
        position_noise=magnitudes.position_noise,
        orientation_noise=magnitudes.orientation_noise,
        dropped=magnitudes.dropped_measurements,
        noise_seed=seed,
    )
