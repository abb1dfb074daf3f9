"""The command line of a node, apart from what ROS reads of it. Needs no ROS."""

import textwrap
from collections.abc import Iterable, Sequence

from annik_core.errors import AnnikError
from annik_ros.parameters import parameter_table
from msg_tools.topics import TOPICS


class UnknownArgument(AnnikError):
    """An argument that is neither ``--help`` nor for ROS."""

    def __init__(self, argument: str, remedy: str) -> None:
        self.argument = argument
        self.remedy = remedy
        super().__init__(f"argument {argument!r} is not understood: {remedy}")


def check_arguments(arguments: Sequence[str]) -> None:
    """Raise UnknownArgument for what ROS would ignore, or take for a topic as ROS 1 did."""
    others, for_ros = [], False
    for argument in arguments:
        if argument == "--ros-args":
            for_ros = True
        elif not for_ros:
            others.append(argument)
        elif argument == "--":
            for_ros = False
    if others:
        raise UnknownArgument(others[0], _remedy(*others))


def _remedy(argument: str, value: str = "VALUE", *further: str) -> str:
    if argument.startswith("__") and ":=" in argument:
        return f"write --ros-args -r {argument}"
    if argument in ("-p", "-r", "--param", "--remap", "--params-file", "--log-level"):
        return f"write --ros-args before {argument}"
    if ":=" in argument:
        return (
            f"write --ros-args -p {argument} for a parameter, or --ros-args -r {argument} for a "
            "topic"
        )
    name, _, given = argument.lstrip("-").partition("=")
    if argument.startswith("-") and name:
        meant = f"{name.replace('-', '_')}:={given or value}"
        return f"write --ros-args -p {meant} for a parameter; --help lists them"
    return "parameters are written as --ros-args -p NAME:=VALUE; --help lists them"


def asks_for_help(arguments: Iterable[str]) -> bool:
    """Whether ``--help`` is among the arguments; ROS has no such argument."""
    return any(argument in ("-h", "--help") for argument in arguments)


def help_text(name: str, summary: str, parameters: type) -> str:
    """What ``--help`` prints of a node with a dataclass of parameters."""
    lines = [
        f"usage: {name} [--ros-args [-p PARAMETER:=VALUE]... [-r TOPIC:=NEW_NAME]... "
        "[-r __ns:=NAMESPACE] [--params-file FILE]]",
        *("", summary),
    ]
    for title, of in (("receives", "subscriber"), ("publishes", "publisher")):
        found = [topic for topic in TOPICS if name in getattr(topic, of)]
        lines += ["", f"{title}:"] if found else []
        for topic in found:
            lines += _entry(f"{topic.name} ({topic.type})", topic.meaning)
    lines += ["", "parameters:"]
    for row in parameter_table(parameters):
        default = list(row.default) if isinstance(row.default, tuple) else row.default
        lines += _entry(f"{row.name} (default {default!r}; {row.allowed})", row.description)
    return "\n".join(lines)


def _entry(head: str, text: str) -> list[str]:
    indent = 6 * " "
    lines = textwrap.wrap(text, 99, initial_indent=indent, subsequent_indent=indent)
    return [f"  {head}", *lines]
