"""Find and load robots: packaged ones by name, others by the path of their definition."""

import errno
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from annik_core.files import bounded_yaml, expanded, read_regular_file
from annik_core.installation import nearest_first, share_directory
from annik_core.robots.arm import arm_from_definition
from annik_core.robots.definition import checked_name
from annik_core.robots.errors import InvalidRobotDefinition, UnknownRobot
from annik_core.robots.gantry import gantry_from_definition
from annik_core.robots.robot import Robot
from annik_core.robots.urdf import serial_chain
from annik_core.robots.urdf_text import BYTE_ORDER_MARK, MAX_LENGTH, decoded

_KINDS = {"arm": arm_from_definition, "gantry": gantry_from_definition}
#: Deepest nesting of a definition; one that contains itself has no end.
_MAX_DEPTH = 16
#: What is called like this is a URDF, even if it does not begin like one.
_URDF_SUFFIXES = (".urdf", ".xml", ".xacro")


def packaged_robots() -> tuple[str, ...]:
    """Names of the robots that come with annik."""
    return tuple(sorted(path.stem for path in (share_directory() / "robots").glob("*.yaml")))


def load_robot(
    source: str | Path,
    *,
    base_frame: str | None = None,
    end_effector_frame: str | None = None,
    joint_box: Mapping[str, Sequence[float | str]] | None = None,
) -> Robot:
    """Load a robot by name, by the path of its definition or URDF, or from the text of a URDF.

    Args:
        source: a packaged robot's name, the path of a definition or a URDF of whatever name, or
            the text of a URDF, as in the parameter ``robot_description``.
        base_frame: of an arm: the link in which poses are given; by default the definition's, or
            else the root of the URDF.
        end_effector_frame: of an arm: the link whose pose is meant; by default the definition's,
            or else the tip of the URDF, if it has only one.
        joint_box: of an arm: [lower, upper] of joints by name [rad or m, or texts with a unit,
            such as 90deg], which replace those of the definition; equal bounds lock a joint.

    Raises:
        UnknownRobot: if there is no such robot or file; lists the packaged names.
        InvalidRobotDefinition: if the definition can't be read or used.
    """
    definition, name = _definition(source)
    given: dict[str, Any] = {
        "base_frame": base_frame,
        "end_effector_frame": end_effector_frame,
        "joint_box": joint_box,
    }
    given = {key: value for key, value in given.items() if value is not None}
    if given:
        if not isinstance(definition, Mapping) or definition.get("kind") != "arm":
            raise InvalidRobotDefinition(name, f"{next(iter(given))} can be given for an arm only")
        known_box = definition.get("joint_box")
        if isinstance(known_box, Mapping):
            if base_frame is not None or end_effector_frame is not None:
                known_box = _box_of_chain(known_box, {**definition, **given}, name)
            given["joint_box"] = {**known_box, **(joint_box or {})}
        definition = {**definition, **given}
    return robot_from_definition(definition, name)


def _box_of_chain(
    box: Mapping[str, Any], definition: Mapping[str, Any], source: str
) -> dict[str, Any]:
    """The part of a definition's joint box that belongs to joints between other frames."""
    urdf, *frames = (definition.get(key) for key in ("urdf", "base_frame", "end_effector_frame"))
    if not isinstance(urdf, str):
        return dict(box)
    base, tip = (None if frame is None else str(frame) for frame in frames)
    chain = serial_chain(urdf, source, base, tip, box)
    return {joint: bounds for joint, bounds in box.items() if joint in chain.joint_names}


def _definition(source: str | Path) -> tuple[Any, str]:
    """The definition as read, and what to call it in an error."""
    if isinstance(source, str) and _is_xml(source):
        return {"kind": "arm", "urdf": source}, "robot_description"
    path = expanded(source)
    if str(source) in packaged_robots():
        path = share_directory() / "robots" / f"{source}.yaml"
    try:
        text = _text(path)
    # ValueError: a path that no system could have; "" is the current folder.
    except (FileNotFoundError, NotADirectoryError, ValueError) as error:
        raise UnknownRobot(str(source), nearest_first(str(source), packaged_robots())) from error
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG or not str(source):
            raise UnknownRobot(str(source), packaged_robots()) from error
        raise _unreadable(path, path, error) from error
    if _is_xml(text) or path.suffix.lower() in _URDF_SUFFIXES:
        return {"kind": "arm", "urdf": text}, str(path)
    try:
        definition = bounded_yaml(text)
    except ValueError as error:
        raise InvalidRobotDefinition(
            str(path), f"neither a URDF, which is XML, nor readable as YAML: {error}"
        ) from error
    if not isinstance(definition, dict):
        raise InvalidRobotDefinition(
            str(path), "neither a URDF, which is XML, nor a mapping of names to values in YAML"
        )
    if "urdf_file" in definition:
        urdf_file = checked_name(definition.pop("urdf_file"), "urdf_file", str(path))
        beside = path.parent / expanded(urdf_file)
        try:
            definition["urdf"] = _text(beside)
        except (OSError, ValueError) as error:
            raise _unreadable(path, beside, error) from error
    return definition, str(path)


def _is_xml(text: str) -> bool:
    return text.removeprefix(BYTE_ORDER_MARK).lstrip().startswith("<")


def _text(path: Path) -> str:
    return decoded(read_regular_file(path, MAX_LENGTH))


def _unreadable(
    definition: Path, path: Path, error: OSError | ValueError
) -> InvalidRobotDefinition:
    reason = getattr(error, "strerror", None) or error
    return InvalidRobotDefinition(str(definition), f"{path} can't be read: {reason}")


def robot_from_definition(definition: Mapping[str, Any], source: str) -> Robot:
    """The robot that a definition describes, such as the one inside a model file.

    The definition is a mapping of JSON data, with ``kind`` and the entries of that kind; the robot
    keeps a copy. Errors call it ``source``.

    Raises:
        InvalidRobotDefinition: naming what is missing or wrong.
    """
    if not isinstance(definition, Mapping):
        raise InvalidRobotDefinition(source, "not a mapping of names to values")
    # A model file carries it as JSON, and the hash is computed from that.
    plain = {key: _plain_data(value, str(key), source) for key, value in definition.items()}
    _check_keys(plain, "the definition", source)
    kind = plain.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InvalidRobotDefinition(
            source, f"kind is {kind!r}; known kinds: {', '.join(sorted(_KINDS))}"
        )
    return _KINDS[kind](plain, source)


def _plain_data(value: Any, where: str, source: str, depth: int = 1) -> Any:
    """A copy of data that JSON can hold without loss."""
    if depth > _MAX_DEPTH:
        raise InvalidRobotDefinition(source, f"nested deeper than {_MAX_DEPTH} levels: {where}")
    if isinstance(value, Mapping):
        _check_keys(value, where, source)
        return {
            key: _plain_data(item, f"{where}.{key}", source, depth + 1)
            for key, item in value.items()
        }
    if isinstance(value, (list, tuple)):
        return [
            _plain_data(item, f"{where}[{index}]", source, depth + 1)
            for index, item in enumerate(value)
        ]
    if isinstance(value, float) and not math.isfinite(value):
        raise InvalidRobotDefinition(source, f"{where} is {value}: not finite")
    if value is None or isinstance(value, (str, bool, int, float)):
        return value
    raise InvalidRobotDefinition(
        source, f"{where} is a {type(value).__name__}, not a text, number, list or mapping"
    )


def _check_keys(mapping: Mapping[Any, Any], where: str, source: str) -> None:
    for key in mapping:
        if not isinstance(key, str):
            raise InvalidRobotDefinition(source, f"{where} has a key that is not text: {key!r}")
