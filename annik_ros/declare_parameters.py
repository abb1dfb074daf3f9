"""Declare a table of parameters on a node, and read the values given to it."""

from __future__ import annotations

from typing import TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as GivenParameter

from annik_core.errors import AnnikError
from annik_ros.parameters import Parameter, parameter_table

Parameters = TypeVar("Parameters")


def declare_parameters(node: Node, parameters: type[Parameters]) -> Parameters:
    """Declare the parameters of a dataclass on a node, with descriptions and ranges.

    A value that is not allowed is refused later too, when the node runs.

    Args:
        node: where to declare them.
        parameters: a dataclass such as :class:`annik_ros.ik_node.parameters.IkNodeParameters`.

    Returns:
        The values given on the command line or in a file, the defaults for the rest.

    Raises:
        AnnikError: if values contradict each other.
        InvalidParameter: if a value has the wrong type or is out of range; nothing but the
            parameters before it is declared.
    """
    rows = parameter_table(parameters)
    values = {row.name: _declare(node, row) for row in rows}
    node.add_on_set_parameters_callback(lambda given: _validated(node, parameters, given))
    return parameters(**values)


def current_parameters(node: Node, parameters: type[Parameters]) -> Parameters:
    """The values that the declared parameters have now."""
    rows = parameter_table(parameters)
    return parameters(
        **{row.name: row.checked(node.get_parameter(row.name).value) for row in rows}
    )


def descriptor(row: Parameter) -> ParameterDescriptor:
    """What ``ros2 param describe`` shows of a parameter."""
    message = ParameterDescriptor(
        name=row.name,
        description=f"{row.description} [{row.unit}]" if row.unit else row.description,
        additional_constraints=f"It must be {row.allowed}.",
        read_only=row.read_only,
    )
    if row.minimum is not None and row.maximum is not None:
        if isinstance(row.default, float):
            message.floating_point_range = [
                FloatingPointRange(from_value=float(row.minimum), to_value=float(row.maximum))
            ]
        elif isinstance(row.default, int):
            message.integer_range = [
                IntegerRange(from_value=int(row.minimum), to_value=int(row.maximum))
            ]
    return message


def _validated(
    node: Node, parameters: type[Parameters], given: list[GivenParameter]
) -> SetParametersResult:
    """Whether new values may be set: by itself ROS knows types and ranges, but nothing else."""
    new = {parameter.name: parameter.value for parameter in given}
    rows = parameter_table(parameters)
    try:
        # All of them, since one may be wrong beside another only.
        parameters(
            **{
                row.name: row.checked(new.get(row.name, node.get_parameter(row.name).value))
                for row in rows
            }
        )
    except AnnikError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def _declare(node: Node, row: Parameter) -> object:
    # Declared first without a type, to see what was given: rclpy would refuse an integer for a
    # double, and its exceptions name neither the range nor the unit.
    untyped = ParameterDescriptor(dynamic_typing=True)
    given = node.declare_parameter(row.name, _plain(row.default), untyped).value
    value = row.checked(given)
    node.undeclare_parameter(row.name)
    node.declare_parameter(row.name, _plain(value), descriptor(row), ignore_override=True)
    return value


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value
