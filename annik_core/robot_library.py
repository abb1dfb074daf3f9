"""Find and load robots: packaged ones by name, others by the path of their definition."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from annik_core.errors import InvalidRobotDefinition, UnknownRobot
from annik_core.gantry import gantry_from_definition
from annik_core.robot import Robot
from annik_core.share_directory import share_directory

_KINDS = {"gantry": gantry_from_definition}
#: A definition is a few levels deep; one of many more, or that holds itself, is none.
_MAX_DEPTH = 16


def packaged_robots() -> tuple[str, ...]:
    """Names of the robots that come with annik."""
    return tuple(sorted(path.stem for path in (share_directory() / "robots").glob("*.yaml")))


def load_robot(name_or_path: str | Path) -> Robot:
    """The robot with this name, or whose definition is at this path.

    Raises:
        UnknownRobot: if there is neither; lists the packaged names.
        InvalidRobotDefinition: if the definition can't be read or used.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = share_directory() / "robots" / f"{name_or_path}.yaml"
    if not path.is_file():
        raise UnknownRobot(str(name_or_path), packaged_robots())
    try:
        definition = yaml.safe_load(path.read_text(encoding="utf-8"))
    # Besides YAMLError, PyYAML lets through whatever an ill-formed date, number or tag runs into.
    except Exception as error:
        raise InvalidRobotDefinition(str(path), f"not readable as YAML: {error}") from error
    return robot_from_definition(definition, str(path))


def robot_from_definition(definition: Mapping[str, Any], source: str) -> Robot:
    """The robot that a definition describes, such as the one inside a model file.

    Args:
        definition: plain data, as JSON has it: a mapping with ``kind`` and what that kind needs.
            The robot keeps a copy.
        source: what to call the definition in an error.

    Raises:
        InvalidRobotDefinition: naming what is missing or wrong.
    """
    if not isinstance(definition, Mapping):
        raise InvalidRobotDefinition(source, "not a mapping of names to values")
    # A model file carries it as JSON, and its hash is taken of that.
    plain = {key: _plain_data(value, str(key), source) for key, value in definition.items()}
    _check_keys(plain, "the definition", source)
    kind = plain.get("kind")
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InvalidRobotDefinition(
            source, f"kind is {kind!r}; known kinds: {', '.join(sorted(_KINDS))}"
        )
    return _KINDS[kind](plain, source)


def _plain_data(value: Any, where: str, source: str, depth: int = 1) -> Any:
    """A copy, if it is what JSON can hold and gives back unchanged."""
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
