"""A robot definition is plain data, as JSON has it, and every slip in it is named. ROS-free."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.refused_definition import refused_definition

from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot


def changed(gantry: Robot, joint: int, **change: object) -> dict[str, Any]:
    definition = copy.deepcopy(dict(gantry.definition))
    definition["joints"][joint].update(change)
    return definition


def refused(definition: Any, *named: str) -> None:
    error = refused_definition(lambda: robot_from_definition(definition, "test"), *named)
    assert error.source == "test"


@pytest.mark.parametrize("kind", [[], {}, None, 1])
def test_a_kind_that_is_not_text(gantry: Robot, kind: object) -> None:
    refused({**gantry.definition, "kind": kind}, repr(kind), "arm", "gantry")


@pytest.mark.parametrize("key", ["ratio", "offset"])
@pytest.mark.parametrize("number", [10**400, "3.0", True, None, [3.0], math.nan], ids=type)
def test_a_number_that_is_none(gantry: Robot, key: str, number: object) -> None:
    refused(changed(gantry, 0, **{key: number}), key)


@pytest.mark.parametrize("key", ["limits", "box"])
@pytest.mark.parametrize("bounds", [["0", "1"], [False, True], [0.0], 0.5, [0, 10**400], [[0], 1]])
def test_bounds_that_are_none(gantry: Robot, key: str, bounds: object) -> None:
    refused(changed(gantry, 0, **{key: bounds}), key)


@pytest.mark.parametrize("key", ["name", "base_frame", "end_effector_frame"])
@pytest.mark.parametrize("name", ["", "  ", 7, None, ["a"], True, "two\nlines", "\ud800"])
def test_a_name_that_is_none(gantry: Robot, key: str, name: object) -> None:
    refused({**gantry.definition, key: name}, key, repr(name), "not a name")
    refused(changed(gantry, 0, name=name), "joint", repr(name), "not a name")


def test_a_workspace_without_end(gantry: Robot) -> None:
    refused(
        changed(gantry, 0, ratio=1e308, limits=[0.0, 10.0], box=[5.0, 6.0]), "ratio", "too large"
    )


@pytest.mark.parametrize("joint", [3, 5])
@pytest.mark.parametrize("box", [[0.0, 1.5], [-0.8, 0.5]])
def test_roll_or_yaw_beyond_half_a_turn(gantry: Robot, joint: int, box: list[float]) -> None:
    """A pose there is that of another roll or yaw, which the workspace may not hold."""
    refused(changed(gantry, joint, limits=[-2.0, 2.0], box=box), "roll", "yaw", "180")


@pytest.mark.parametrize("joint", [3, 5])
def test_roll_or_yaw_up_to_half_a_turn(gantry: Robot, joint: int) -> None:
    box = [(-math.pi + math.pi / 3) / 3, (math.pi + math.pi / 3) / 3]
    robot_from_definition(changed(gantry, joint, limits=[-2.0, 2.0], box=box), "test")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("made: 2024-05-01", ["made is a date"]),
        ("notes: {1: one}", ["notes", "key that is not text"]),
        ("1: one", ["key that is not text"]),
        ("notes: !!set {a, b}", ["notes is a set"]),
        ("notes: !!binary aGk=", ["notes is a bytes"]),
        ("notes: [.nan]", ["notes[0] is nan", "not finite"]),
        ("notes: &a [*a]", ["alias", "levels"]),
    ],
)
def test_yaml_that_is_not_plain_data(
    gantry: Robot, tmp_path: Path, text: str, named: list[str]
) -> None:
    """YAML knows more than JSON; a model file could not carry it."""
    path = tmp_path / "robot.yaml"
    path.write_text(f"{yaml.safe_dump(dict(gantry.definition))}{text}\n")
    assert refused_definition(lambda: load_robot(path), *named).source == str(path)


@pytest.mark.parametrize(
    "text", ["made: 2024-13-45", "made: !!timestamp x", "a: !!bool x", "a: !!int ''", "[" * 5000]
)
def test_yaml_that_the_reader_stumbles_over(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    error = refused_definition(lambda: load_robot(path))
    assert error.source == str(path)
    assert "neither a URDF, which is XML, nor readable as YAML" in error.problem
    assert error.__cause__ is not None


def test_further_entries_are_kept(gantry: Robot) -> None:
    """Whatever else JSON can hold is part of the definition, and of its hash."""
    notes = {"by": ["me", None, True, 1, 2.5], "where": {}}
    robot = robot_from_definition({**gantry.definition, "notes": notes}, "test")
    assert robot.definition["notes"] == notes
    assert robot.definition_hash != gantry.definition_hash


def test_the_robot_keeps_a_copy(gantry: Robot) -> None:
    definition = copy.deepcopy(dict(gantry.definition))
    robot = robot_from_definition(definition, "test")
    definition["joints"][0]["ratio"] = 2.0
    assert robot.definition == gantry.definition
    assert robot.definition_hash == gantry.definition_hash
