"""The parameter tables and their checks. Needs no ROS."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import dataclass

import pytest

from annik_core.safety import AcceptanceLimits
from annik_ros.fake_robot.parameters import FakeRobotParameters
from annik_ros.ik_node.parameters import IkNodeParameters
from annik_ros.parameter_tables import PARAMETER_TABLES
from annik_ros.parameters import InvalidParameter, Parameter, parameter, parameter_table

ROWS = [(node, row) for node, table in PARAMETER_TABLES.items() for row in table]


@dataclass(frozen=True)
class _Example:
    switch: bool = parameter(False, "A switch.")
    number: int = parameter(3, "A number.", minimum=1, maximum=5)
    length: float = parameter(0.5, "A length.", unit="m", minimum=0.0, maximum=1.0)
    limit: float = parameter(math.inf, "A limit.", minimum=0.0, maximum=math.inf)
    colour: str = parameter("red", "A colour.", choices=("red", "blue"))
    place: tuple[float, ...] = parameter((0.0, 0.0, 0.0), "A place.", unit="m")


def _row(name: str) -> Parameter:
    return next(row for row in parameter_table(_Example) if row.name == name)


@pytest.mark.parametrize(("node", "row"), ROWS, ids=lambda value: getattr(value, "name", value))
def test_every_parameter_is_described_and_its_default_is_allowed(
    node: str, row: Parameter
) -> None:
    """A sentence, a type that ROS knows, and a default that passes its own check."""
    assert row.description.endswith(".")
    assert row.checked(row.default) == row.default
    assert row.type_name in ("bool", "integer", "double", "string", "double array", "string array")
    assert (row.minimum is None) == (row.maximum is None)


def test_the_tables_need_no_ros() -> None:
    """So that documentation can be generated anywhere."""
    code = "import sys, annik_ros.parameter_tables; sys.exit('rclpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_values_are_fields() -> None:
    """A table is a dataclass: typed, and usable without a node."""
    assert FakeRobotParameters().robot == "gantry"
    assert IkNodeParameters().acceptance_limits == AcceptanceLimits()


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("switch", True, True),
        ("number", 5, 5),
        ("length", 1, 1.0),
        ("length", 0.25, 0.25),
        ("limit", math.inf, math.inf),
        ("colour", "blue", "blue"),
        ("place", [1, 2, 3], (1.0, 2.0, 3.0)),
        ("place", [0.5, 1.5, 2.5], (0.5, 1.5, 2.5)),
    ],
)
def test_an_allowed_value_is_taken(name: str, given: object, value: object) -> None:
    """With an integer taken for the double that it means."""
    checked = _row(name).checked(given)
    assert checked == value
    assert type(checked) is type(value)


@pytest.mark.parametrize(
    ("name", "given", "allowed"),
    [
        ("switch", 1, "a bool"),
        ("switch", "true", "a bool"),
        ("number", 0, "an integer from 1 to 5"),
        ("number", 6, "an integer from 1 to 5"),
        ("number", 2.0, "an integer"),
        ("number", True, "an integer"),
        ("length", -0.1, "a double from 0 to 1 [m]"),
        ("length", math.nan, "a double from 0 to 1 [m]"),
        ("length", math.inf, "a double from 0 to 1 [m]"),
        ("length", "long", "a double"),
        ("length", False, "a double"),
        ("limit", -math.inf, "a double from 0 to inf"),
        ("limit", math.nan, "a double from 0 to inf"),
        ("colour", "green", "one of red, blue"),
        ("colour", 1, "one of red, blue"),
        ("place", [1.0, 2.0], "3 finite numbers [m]"),
        ("place", [1.0, 2.0, math.nan], "3 finite numbers [m]"),
        ("place", [True, 2.0, 3.0], "3 finite numbers [m]"),
        ("place", ["1", "2", "3"], "3 finite numbers [m]"),
        ("place", "abc", "3 finite numbers [m]"),
        ("place", 1.0, "3 finite numbers [m]"),
        ("place", None, "3 finite numbers [m]"),
    ],
)
def test_any_other_value_is_refused_with_what_is_allowed(
    name: str, given: object, allowed: str
) -> None:
    """The error names the parameter, the value and the range with its unit."""
    with pytest.raises(InvalidParameter) as caught:
        _row(name).checked(given)
    assert f"parameter {name} is {given!r}" in str(caught.value)
    assert allowed in str(caught.value)
