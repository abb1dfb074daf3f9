"""The arguments of the launch files, checked before anything starts. Needs no ROS."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from annik_core.errors import InvalidValue, one_line
from annik_core.files import bounded_yaml, expanded, read_text
from annik_core.installation import ament_prefixes, model_path, packaged_models
from annik_core.target_paths import PathKind, TargetPath
from annik_ros.parameters import parameter_table
from annik_ros.target_publisher.parameters import TargetPublisherParameters

LOG_LEVELS = ("debug", "info", "warn", "error", "fatal")

_NAMESPACE = r"/?([A-Za-z_]\w*(/[A-Za-z_]\w*)*)?"
_REMAPPING = r"([^\s:=]+(?:://[^\s:=]+)?):=([^\s:=]+)"
_SETTINGS = {row.name: row.setting for row in parameter_table(TargetPublisherParameters)}


class Argument(NamedTuple):
    """An argument of a launch file; ``check`` may raise an :class:`InvalidValue`."""

    default: str
    meaning: str
    check: Callable[[str, str], Any]


def checked_arguments(values: Mapping[str, str]) -> dict[str, Any]:
    """The values of arguments for their texts; raise AnnikError for the first not allowed."""
    checked = {name: ARGUMENTS[name].check(name, text) for name, text in values.items()}
    if checked.get("path") is PathKind.CSV:
        TargetPath(path=PathKind.CSV, csv_file=checked["csv_file"]).poses()
    return checked


def check_names(given: Sequence[str], known: Sequence[str]) -> None:
    """Raise InvalidValue for ``NAME:=VALUE`` of nearly a known name, which launch ignores."""
    for name in (text.partition(":=")[0] for text in given if ":=" in text):
        near = get_close_matches(name, known, n=1, cutoff=0.7)
        if name not in known and near:
            raise InvalidValue("argument", name, f"{near[0]}, or one of {', '.join(known)}")


def node_parameters(file: str, nodes: Sequence[str]) -> dict[str, Any]:
    """What a parameter file has for any of some nodes, given by their full names.

    Raises:
        InvalidValue: if the file can't be read, or has nothing for these nodes: then they would
            run without what is meant for them.
    """
    try:
        content = bounded_yaml(read_text(file))
    except (OSError, ValueError) as error:
        allowed = f"a file of parameters ({one_line(error)})"
        raise InvalidValue("params_file", file, allowed) from error
    entries = list(_entries(content))
    found = [
        parameters
        for pattern, parameters in entries
        if any(re.fullmatch(_as_expression(pattern), node) for node in nodes)
    ]
    if not found:
        names = ", ".join(pattern for pattern, _ in entries) or "no ros__parameters"
        allowed = f"a file with parameters of {' or '.join(nodes)}, such as /**; it has {names}"
        raise InvalidValue("params_file", file, allowed)
    return {name: value for parameters in found for name, value in parameters.items()}


def _entries(content: Any, prefix: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """The names of nodes in a parameter file, with wildcards, and their parameters."""
    for key, value in content.items() if isinstance(content, dict) else ():
        if key == "ros__parameters" and isinstance(value, dict):
            yield prefix or "/**", value
        else:
            yield from _entries(value, f"{prefix}/{str(key).strip('/')}")


def _as_expression(pattern: str) -> str:
    parts = {"**": r"(/\w+)*", "*": r"/\w+"}
    return "".join(parts.get(part, f"/{re.escape(part)}") for part in pattern.split("/")[1:])


def _model(name: str, text: str) -> str:
    if text and not model_path(text).is_file():
        allowed = f"the path of a model file, or one of {', '.join(packaged_models())}"
        raise InvalidValue(name, text, allowed)
    return text


def _setting(name: str, text: str) -> Any:
    setting = _SETTINGS[name]
    value: object = text
    if isinstance(setting.default, (int, float)):
        for number in (int, float):
            try:
                value = number(text)
                break
            except ValueError:
                pass
    return setting.checked(value)


def _new_folder(name: str, text: str) -> str:
    folder = expanded(text)
    if text and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidValue(name, text, "a folder that is new or empty")
    return _path(name, text)


def _namespace(name: str, text: str) -> str:
    if not re.fullmatch(_NAMESPACE, text, re.ASCII):
        raise InvalidValue(name, text, "letters, digits, _ and /, such as left or /robots/left")
    return text


def _truth(name: str, text: str) -> bool | None:
    values = {"": None, "true": True, "false": False}
    if text.lower() not in values:
        raise InvalidValue(name, text, "true or false")
    return values[text.lower()]


def _viewer(name: str, text: str) -> bool:
    wanted = bool(_truth(name, text))
    if wanted and find_spec("viser") is None:
        raise InvalidValue(name, text, "false: viser is not installed: pip install '.[view]'")
    return wanted


def _rviz(name: str, text: str) -> bool:
    wanted = bool(_truth(name, text))
    if wanted and not _is_ros_package("rviz2"):
        allowed = "false: rviz2 is not installed: sudo apt install ros-jazzy-rviz2"
        raise InvalidValue(name, text, allowed)
    return wanted


def _is_ros_package(name: str) -> bool:
    """Whether the ament index has a package."""
    index = Path("share", "ament_index", "resource_index", "packages", name)
    return any((prefix / index).is_file() for prefix in ament_prefixes())


def _log_level(name: str, text: str) -> str:
    if text.lower() not in ("", *LOG_LEVELS):
        raise InvalidValue(name, text, f"one of {', '.join(LOG_LEVELS)}")
    return text.lower()


def _remappings(name: str, text: str) -> list[tuple[str, str]]:
    pairs = [re.fullmatch(_REMAPPING, part) for part in text.split()]
    if None in pairs:
        raise InvalidValue(name, text, "FROM:=TO, several separated by spaces")
    return [(pair[1], pair[2]) for pair in pairs if pair]


def _path(_: str, text: str) -> str:
    # launch expands no ~, and starts nodes without a file that it does not find.
    return str(expanded(text)) if text else text


ARGUMENTS: Mapping[str, Argument] = {
    "model": Argument("", "model file, or name of a packaged model", _model),
    "namespace": Argument("", "namespace of all nodes and topics", _namespace),
    "params_file": Argument("", "file of parameters; arguments take precedence", _path),
    "remappings": Argument("", "remapped names: FROM:=TO, separated by spaces", _remappings),
    "use_sim_time": Argument("", "true: the clock is /clock", _truth),
    "autostart": Argument("", "false: wait for lifecycle transitions", _truth),
    "viewer": Argument("false", "true: show the robot in the browser too", _viewer),
    "rviz": Argument("false", "true: show the robot in RViz too", _rviz),
    "log_level": Argument("", f"of the nodes: {', '.join(LOG_LEVELS)}", _log_level),
    "path": Argument(
        "diagonal",
        f"path to follow: {', '.join(kind.value for kind in PathKind)}; see target_publisher",
        _setting,
    ),
    "csv_file": Argument("", "file of targets, for path:=csv", _path),
    "rate": Argument("50.0", "targets a second", _setting),
    "loops": Argument("1", "times to follow the path; 0: without end", _setting),
    "bag": Argument("", "folder of a bag to record; empty: none", _new_folder),
}
