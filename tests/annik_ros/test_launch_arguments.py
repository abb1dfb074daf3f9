"""The arguments of the launch files. Needs neither ROS nor launch."""

from __future__ import annotations

from pathlib import Path

import pytest

from annik_core.errors import AnnikError, InvalidValue
from annik_core.target_paths import PathKind, UnreadableTargetFile
from annik_ros.launch_arguments import (
    ARGUMENTS,
    check_names,
    checked_arguments,
    node_parameters,
)


def test_the_defaults_are_allowed() -> None:
    values = checked_arguments({name: one.default for name, one in ARGUMENTS.items()})
    assert values["rate"] == 50.0 and values["loops"] == 1
    assert values["path"] is PathKind.DIAGONAL
    assert values["use_sim_time"] is None and values["remappings"] == []


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("rate", "20", 20.0),
        ("rate", "1e2", 100.0),
        ("loops", "0", 0),
        ("model", "ur5e", "ur5e"),
        ("model", str(Path(__file__).parents[2] / "models" / "gantry.onnx"), None),
        ("namespace", "/robots/left", "/robots/left"),
        ("namespace", "left", "left"),
        ("use_sim_time", "True", True),
        ("autostart", "false", False),
        ("log_level", "DEBUG", "debug"),
        ("viewer", "false", False),
        ("rviz", "False", False),
        ("bag", "new", "new"),
        (
            "remappings",
            "joint_states:=/arm/joint_states  target_pose:=goal",
            [("joint_states", "/arm/joint_states"), ("target_pose", "goal")],
        ),
    ],
)
def test_what_is_allowed(name: str, text: str, value: object) -> None:
    assert checked_arguments({name: text}) == {name: text if value is None else value}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("rate", "abc"),
        ("rate", "0"),
        ("rate", "nan"),
        ("rate", ""),
        ("loops", "x"),
        ("loops", "1.5"),
        ("loops", "-1"),
        ("model", "no.onnx"),
        ("model", "ur5"),
        ("path", "spiral"),
        ("namespace", "left arm"),
        ("namespace", "1st"),
        ("namespace", "left//arm"),
        ("namespace", "left/"),
        ("use_sim_time", "maybe"),
        ("autostart", "2"),
        ("log_level", "loud"),
        ("remappings", "joint_states"),
        ("remappings", "a:=b:=c"),
        ("remappings", ":=b"),
        ("viewer", "maybe"),
        ("rviz", "2"),
        ("bag", str(Path(__file__).parent)),
        ("bag", __file__),
    ],
)
def test_what_is_not_allowed(name: str, text: str) -> None:
    with pytest.raises(InvalidValue) as error:
        checked_arguments({name: text})
    assert error.value.name == name


def test_a_file_of_targets_is_read_before_anything_starts(tmp_path: Path) -> None:
    with pytest.raises(InvalidValue):
        checked_arguments({"path": "csv", "csv_file": ""})
    file = tmp_path / "targets.csv"
    with pytest.raises(UnreadableTargetFile):
        checked_arguments({"path": "csv", "csv_file": str(file)})
    file.write_text("x,y,z,qx,qy,qz,qw\n0.3,0.3,0.6,0,0,0,1\n", encoding="utf-8")
    assert checked_arguments({"path": "csv", "csv_file": str(file)})["csv_file"] == str(file)


def test_a_path_of_home_is_expanded_since_launch_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It starts nodes without the parameters of a file that it does not find."""
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "x.yaml").write_text("/**: {ros__parameters: {model: ur5e}}", encoding="utf-8")
    for name, text in (("params_file", "~/x.yaml"), ("bag", "~/bag")):
        assert checked_arguments({name: text}) == {name: str(tmp_path / text[2:])}


def test_a_name_that_is_nearly_an_argument_is_refused() -> None:
    known = ("model", "namespace", "rate")
    check_names(["model:=ur5e", "rate:=3", "other_thing:=1"], known)
    for wrong in ("modle:=ur5e", "namspace:=left", "rat:=5", "models:=ur5e"):
        with pytest.raises(InvalidValue):
            check_names([wrong], known)


@pytest.mark.parametrize(
    ("content", "node"),
    [
        ("/**: {ros__parameters: {model: ur5e}}", "/ik_node"),
        ("/**: {ros__parameters: {model: ur5e}}", "/left/arm/ik_node"),
        ("ik_node: {ros__parameters: {model: ur5e}}", "/ik_node"),
        ("/ik_node: {ros__parameters: {model: ur5e}}", "/ik_node"),
        ("/left/ik_node: {ros__parameters: {model: ur5e}}", "/left/ik_node"),
        ("left: {ik_node: {ros__parameters: {model: ur5e}}}", "/left/ik_node"),
        ("/*/ik_node: {ros__parameters: {model: ur5e}}", "/left/ik_node"),
        ("/**/ik_node: {ros__parameters: {model: ur5e}}", "/ik_node"),
        (
            "/**: {ros__parameters: {model: panda}}\nik_node: {ros__parameters: {model: ur5e}}",
            "/ik_node",
        ),
    ],
)
def test_parameters_of_a_file(tmp_path: Path, content: str, node: str) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(content, encoding="utf-8")
    assert node_parameters(str(file), [node]) == {"model": "ur5e"}


@pytest.mark.parametrize(
    "content",
    [
        "ik_node: {ros__parameters: {model: ur5e}}",
        "/right/ik_node: {ros__parameters: {model: ur5e}}",
        "/*/*/ik_node: {ros__parameters: {model: ur5e}}",
        "model: ur5e",
        "",
        "[1, 2]",
        "{",
        "\x00",
    ],
)
def test_a_file_without_parameters_of_the_node_is_refused(tmp_path: Path, content: str) -> None:
    """A limit that was meant for the node would not hold."""
    file = tmp_path / "parameters.yaml"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InvalidValue) as error:
        node_parameters(str(file), ["/left/ik_node"])
    assert error.value.name == "params_file"


def test_a_file_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(AnnikError):
        node_parameters(str(tmp_path / "no.yaml"), ["/ik_node"])


def test_rviz_is_started_only_where_the_index_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    with pytest.raises(InvalidValue) as error:
        checked_arguments({"rviz": "true"})
    assert error.value.name == "rviz"
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "rviz2").touch()
    assert checked_arguments({"rviz": "true"}) == {"rviz": True}


def test_the_page_needs_viser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("annik_ros.launch_arguments.find_spec", lambda name: None)
    with pytest.raises(InvalidValue) as error:
        checked_arguments({"viewer": "true"})
    assert error.value.name == "viewer"
