"""Find and load robots: packaged ones by name, others by the path of their definition."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from annik_core.errors import InvalidRobotDefinition, UnknownRobot
from annik_core.gantry import gantry_from_definition
from annik_core.robot import Robot
from annik_core.share_directory import share_directory

_KINDS = {"gantry": gantry_from_definition}


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
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InvalidRobotDefinition(str(path), f"not readable as YAML: {error}") from error
    return robot_from_definition(definition, str(path))


def robot_from_definition(definition: Mapping[str, Any], source: str) -> Robot:
    """The robot that a definition describes, such as the one inside a model file.

    Args:
        definition: plain data: a mapping with ``kind`` and what that kind needs.
        source: what to call the definition in an error.

    Raises:
        InvalidRobotDefinition: naming what is missing or wrong.
    """
    if not isinstance(definition, Mapping):
        raise InvalidRobotDefinition(source, "not a mapping of names to values")
    kind = definition.get("kind")
    if kind not in _KINDS:
        raise InvalidRobotDefinition(
            source, f"kind is {kind!r}; known kinds: {', '.join(sorted(_KINDS))}"
        )
    return _KINDS[kind](definition, source)
