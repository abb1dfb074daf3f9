"""The parameters of the nodes, and how they survive ROS tools. Needs no ROS."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from enum import Enum

import pytest
import yaml
from support.processes import run_python

from annik_core.errors import InvalidValue
from annik_core.safety import AcceptanceLimits, CommandSafety
from annik_core.settings import setting
from annik_core.solver.result import RefinementOptions
from annik_ros.fake_robot.parameters import FakeRobotParameters
from annik_ros.ik_node.parameters import IkNodeParameters
from annik_ros.parameters import (
    Parameter,
    from_values,
    number_meant,
    parameter,
    parameter_table,
    parameters_of,
)
from docs.parameter_tables import PARAMETER_TABLES

ROWS = [
    pytest.param(row, id=f"{node}-{row.name}")
    for node, table in PARAMETER_TABLES.items()
    for row in table
]


class _Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class _Limits:
    limit: float = setting(
        math.inf, "A limit.", unit="m", greater_than=0.0, within=(None, math.inf)
    )
    small: float = setting(5e-7, "A small one.", within=(1e-12, 1.0))
    noise: float = setting(2e-5, "Noise.", within=(0.0, 1.0))
    box: tuple[float, ...] = setting((math.inf, -math.inf), "A box.", within=(-math.inf, math.inf))


@dataclass(frozen=True)
class _Example:
    number: int = parameter(3, "A number.", within=(1, 5))
    limits: _Limits = parameters_of(_Limits, read_only=False, names={"small": "renamed"})
    colour: _Colour = parameter(_Colour.RED, "A colour.", read_only=False)


EXAMPLE = {row.name: row for row in parameter_table(_Example)}


def as_ros2_param_load_hands_it_on(value: object) -> object:
    """By way of ``ros2 param dump``: YAML, then each value as a string, read as YAML again."""
    dumped = yaml.dump(list(value) if isinstance(value, tuple) else value)
    text = str(yaml.safe_load(dumped))
    loaded = yaml.safe_load(text)
    return text if loaded is None else loaded


@pytest.mark.parametrize("row", ROWS)
def test_every_parameter_is_described_and_its_default_is_allowed(row: Parameter) -> None:
    assert row.description.endswith(".")
    assert row.checked(row.default) == row.default
    assert isinstance(row.default, (bool, int, float, str, tuple))


@pytest.mark.parametrize("row", ROWS)
def test_every_default_survives_dump_and_load(row: Parameter) -> None:
    default = list(row.default) if isinstance(row.default, tuple) else row.default
    assert yaml.safe_load(yaml.dump(default)) == default
    if not row.read_only:
        restored = as_ros2_param_load_hands_it_on(row.default)
        assert restored == default
        assert type(restored) is type(default)
        if isinstance(default, list):
            assert [type(item) for item in restored] == [type(item) for item in default]


@pytest.mark.parametrize("row", ROWS)
def test_every_default_is_finite(row: Parameter) -> None:
    numbers = row.default if isinstance(row.default, tuple) else (row.default,)
    assert all(math.isfinite(x) for x in numbers if isinstance(x, float))


@pytest.mark.process
def test_the_tables_need_no_ros() -> None:
    """So that documentation can be generated anywhere."""
    code = "import sys, docs.parameter_tables; sys.exit('rclpy' in sys.modules)"
    assert run_python("-c", code).returncode == 0


@pytest.mark.parametrize("node", PARAMETER_TABLES)
def test_no_parameter_is_declared_twice(node: str) -> None:
    names = [row.name for row in PARAMETER_TABLES[node]]
    assert len(names) == len(set(names))


def test_the_defaults_of_the_parameters_are_those_of_the_settings() -> None:
    assert FakeRobotParameters().robot == "gantry"
    defaults = {row.name: row.default for row in PARAMETER_TABLES["ik_node"]}
    assert defaults["max_joint_velocity"] == 0.0
    parameters = from_values(IkNodeParameters, defaults)
    assert parameters == IkNodeParameters()
    assert parameters.acceptance_limits == AcceptanceLimits()
    assert parameters.command_safety == CommandSafety()
    assert parameters.refinement == RefinementOptions()


def test_settings_are_included_in_their_place_and_under_their_names() -> None:
    assert list(EXAMPLE) == ["number", "limit", "renamed", "noise", "box", "colour"]
    assert [row.read_only for row in EXAMPLE.values()] == [True, *[False] * 5]


@pytest.mark.parametrize(
    ("name", "default", "allowed", "description"),
    [
        ("number", 3, "an integer from 1 to 5", "A number."),
        ("limit", 0.0, "a number greater than 0 [m], or 0", "A limit. 0: no limit."),
        (
            "renamed",
            0.0,
            "a number from 1e-12 to 1, or 0",
            "A small one. 0: the default, 5e-07.",
        ),
        ("noise", 2e-5, "a number from 0 to 1", "Noise."),
        ("box", (1000.0, -1000.0), "2 numbers", "A box. 1000: no bound."),
        ("colour", "red", "one of red, blue", "A colour."),
    ],
)
def test_a_parameter_is_a_setting_in_values_that_can_be_restored(
    name: str, default: object, allowed: str, description: str
) -> None:
    row = EXAMPLE[name]
    assert (row.default, row.allowed, row.description) == (default, allowed, description)


@pytest.mark.parametrize(
    ("name", "given", "held", "meant"),
    [
        ("number", 5, 5, 5),
        ("limit", 0.0, 0.0, math.inf),
        ("limit", 0, 0.0, math.inf),
        ("limit", math.inf, 0.0, math.inf),
        ("limit", 2, 2.0, 2.0),
        ("renamed", 0.0, 0.0, 5e-7),
        ("renamed", 1e-6, 1e-6, 1e-6),
        ("noise", 0.0, 0.0, 0.0),
        ("box", [1000.0, 5], (1000.0, 5.0), (math.inf, 5.0)),
        ("box", [math.inf, -2e3], (1000.0, -1000.0), (math.inf, -math.inf)),
        ("colour", "blue", "blue", _Colour.BLUE),
    ],
)
def test_an_allowed_value_is_held_as_ros_can_restore_it(
    name: str, given: object, held: object, meant: object
) -> None:
    row = EXAMPLE[name]
    checked = row.checked(given)
    assert checked == held
    assert type(checked) is type(held)
    assert row.setting_value(given) == row.setting_value(checked) == meant


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("number", 6),
        ("number", "3"),
        ("limit", -1.0),
        ("limit", math.nan),
        ("limit", False),
        ("limit", "0.5"),
        ("limit", "5e-07"),
        ("renamed", 2.0),
        ("box", [1.0]),
        ("box", [math.nan, 0.0]),
        ("colour", "green"),
    ],
)
def test_any_other_value_is_refused_with_what_is_allowed(name: str, given: object) -> None:
    with pytest.raises(InvalidValue) as caught:
        EXAMPLE[name].checked(given)
    assert (caught.value.name, caught.value.value) == (name, given)
    assert caught.value.allowed == EXAMPLE[name].allowed


def test_values_of_all_parameters_make_the_dataclass() -> None:
    values = {
        "number": 1,
        "limit": 0,
        "renamed": 0.5,
        "noise": 0.0,
        "box": [0, 1],
        "colour": "blue",
    }
    assert from_values(_Example, values) == _Example(
        1, _Limits(math.inf, 0.5, 0.0, (0.0, 1.0)), _Colour.BLUE
    )


@pytest.mark.parametrize("number", [5e-7, 1e-5, 1e16, math.inf, -math.inf, 5e-5])
def test_the_string_that_ros2_param_load_makes_of_a_number_is_that_number(number: float) -> None:
    assert isinstance(as_ros2_param_load_hands_it_on(number), str)
    assert number_meant(as_ros2_param_load_hands_it_on(number)) == number


@pytest.mark.parametrize("text", ["0.5", "1", "1e-6", "fast", "", "5.0e-07", "infinity"])
def test_other_strings_are_no_numbers(text: str) -> None:
    assert number_meant(text) == text


@pytest.mark.slow
def test_a_stale_parameter_file_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    from docs import update_docs

    monkeypatch.setattr(sys, "argv", ["update_docs", "--check"])
    monkeypatch.setattr(update_docs, "parameter_file", lambda node: "stale")
    with pytest.raises(SystemExit) as ended:
        update_docs.main()
    for node in PARAMETER_TABLES:
        assert f"config/{node}.yaml" in str(ended.value.code)
