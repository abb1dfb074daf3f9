"""Declare the parameters of a dataclass on a node, and read their values."""

from collections.abc import Iterable
from difflib import SequenceMatcher
from typing import TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as GivenParameter

from annik_core.errors import AnnikError, InvalidValue
from annik_ros.parameters import Parameter, from_values, number_meant, parameter_table

Parameters = TypeVar("Parameters")

#: Parameters of one node of annik whose names are much like one of another node.
OF_OTHER_NODES = frozenset({"max_orientation_residual", "max_orientation_spread", "mode"})


class MisspeltParameter(AnnikError):
    """A parameter that the node does not have was given, and it has one of nearly this name."""

    def __init__(self, given: str, meant: str) -> None:
        self.given = given
        self.meant = meant
        super().__init__(
            f"there is no parameter {given!r}: write {meant!r}; --help lists all. A parameter of "
            "another node belongs under the name of that node in a parameter file"
        )


def declare_parameters(node: Node, parameters: type[Parameters]) -> Parameters:
    """Declare the parameters of a dataclass on a node, and return their values.

    Values that are not allowed are refused later too, while the node runs.

    Raises:
        MisspeltParameter: if a name was given that is nearly that of a parameter.
        AnnikError: if a value has the wrong type, is out of range or contradicts another.
    """
    rows = {row.name: row for row in parameter_table(parameters)}
    _check_names(node, rows)
    values = {row.name: _declare(node, row) for row in rows.values()}
    node.add_pre_set_parameters_callback(lambda given: [_meant(rows, one) for one in given])
    node.add_on_set_parameters_callback(lambda given: _validated(node, parameters, given))
    return from_values(parameters, values)


def current_parameters(node: Node, parameters: type[Parameters]) -> Parameters:
    """The values that the declared parameters have now."""
    rows = parameter_table(parameters)
    return from_values(parameters, {row.name: node.get_parameter(row.name).value for row in rows})


def descriptor(row: Parameter) -> ParameterDescriptor:
    """The output of ``ros2 param describe`` for a parameter."""
    setting = row.setting
    message = ParameterDescriptor(
        name=row.name,
        description=f"{row.description} [{setting.unit}]" if setting.unit else row.description,
        additional_constraints=f"It must be {row.allowed}.",
        read_only=row.read_only,
    )
    lowest = setting.minimum if setting.greater_than is None else setting.greater_than
    if lowest is not None and setting.maximum is not None:
        if isinstance(setting.default, float):
            message.floating_point_range = [
                FloatingPointRange(
                    from_value=0.0 if row.zero_is_default else float(lowest),
                    to_value=float(setting.maximum),
                )
            ]
        elif isinstance(setting.default, int):
            message.integer_range = [
                IntegerRange(from_value=int(lowest), to_value=int(setting.maximum))
            ]
    return message


def _check_names(node: Node, names: Iterable[str]) -> None:
    """Refuse misspelt parameters; say which others are ignored, as those of a shared file are."""
    declared = {*names, *node.list_parameters([], 0).names}
    # rclpy says nowhere else what was given.
    given = set(node._parameter_overrides) - declared
    for name in sorted(given - OF_OTHER_NODES):
        meant = meant_parameter(name, declared)
        if meant is not None:
            raise MisspeltParameter(name, meant)
    if given:
        node.get_logger().info(f"not parameters of this node, ignored: {', '.join(sorted(given))}")


def meant_parameter(name: str, declared: Iterable[str]) -> str | None:
    """The parameter of nearly this name: letters missing, added, swapped, wrong or in capitals."""
    meant = max(declared, key=lambda one: _likeness(name, one))
    return meant if _likeness(name, meant) >= 0.8 else None


def _likeness(name: str, other: str) -> float:
    """1 for the same letters in any order, 0 for none in common."""
    name, other = (text.lower().replace("_", "") for text in (name, other))
    if sorted(name) == sorted(other):
        return 1.0
    if len(name) == len(other) and sum(map(str.__ne__, name, other)) == 1:
        # Those that differ in the first letter are other words, such as joints and points.
        return 0.9 if name[0] == other[0] else 0.0
    return SequenceMatcher(None, name, other).ratio()


def _meant(rows: dict[str, Parameter], given: GivenParameter) -> GivenParameter:
    """What is meant by a value that ROS tools give another type, such as an integer for a double.

    What is not allowed stays as it is, to be refused.
    """
    row = rows.get(given.name)
    if row is None or row.read_only:
        return given
    value = given.value
    if isinstance(row.default, float):
        value = number_meant(value)
    try:
        return GivenParameter(given.name, value=_plain(row.checked(value)))
    except InvalidValue:
        return given


def _validated(
    node: Node, parameters: type[Parameters], given: list[GivenParameter]
) -> SetParametersResult:
    """Whether new values may be set; ROS itself checks types and ranges only."""
    new = {parameter.name: parameter.value for parameter in given}
    rows = parameter_table(parameters)
    values = {row.name: new.get(row.name, node.get_parameter(row.name).value) for row in rows}
    try:
        # All of them, since a value may be wrong only in combination with another.
        from_values(parameters, values)
    except AnnikError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def _declare(node: Node, row: Parameter) -> object:
    # Not rclpy's own override: it would refuse an integer for a double, and its exceptions name
    # neither the range nor the unit.
    given = node._parameter_overrides.get(row.name)
    value = _plain(row.checked(row.default if given is None else given.value))
    node.declare_parameter(row.name, value, descriptor(row), ignore_override=True)
    return value


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value
