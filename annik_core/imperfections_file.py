"""Imperfections from a YAML file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from annik_core.imperfections import (
    JOINT_ENTRIES,
    MEASUREMENT_ENTRIES,
    Imperfections,
    InvalidImperfections,
    check_arm,
    check_fit,
    check_seed,
)
from annik_core.robot import Robot


def read_imperfections(path: str | Path, robot: Robot) -> Imperfections:
    """The imperfections of an arm that a file describes, in metres and radians.

    Args:
        path: a YAML file. ``joints`` maps names of joints to what is wrong with each:
            ``joint_zero``, ``joint_offset``, ``link_length``, ``link_twist``,
            ``transmission_amplitude``, ``transmission_phase`` and ``backlash``; beside it are
            ``position_noise``, ``orientation_noise``, ``dropped`` and ``noise_seed``. Their
            meaning is in :class:`annik_core.imperfections.Imperfections`; what is left out is 0.
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
