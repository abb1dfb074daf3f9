"""What the launch files start, by a stand-in for launch, which is in no wheel.

With the real one: tests/integration/test_launch_files.py.
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from annik_core.installation import share_directory

LAUNCH = share_directory() / "launch"
NODES = {
    "annik.launch.py": ["ik_node", "fake_robot"],
    "robot.launch.py": ["ik_node"],
    "demo.launch.py": ["ik_node", "fake_robot", "target_publisher"],
}


@pytest.fixture(autouse=True)
def _stand_in_for_launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each class its name and its arguments; and the index says that rviz2 is installed."""

    def module(name: str, **classes: Any) -> None:
        stand_in = ModuleType(name)
        stand_in.__dict__.update(classes)
        monkeypatch.setitem(sys.modules, name, stand_in)

    def record(**arguments: Any) -> SimpleNamespace:
        return SimpleNamespace(**arguments)

    module("launch", LaunchDescription=list, LaunchDescriptionEntity=object)
    module(
        "launch.actions",
        DeclareLaunchArgument=lambda name, **arguments: record(name=name, **arguments),
        OpaqueFunction=record,
        TimerAction=record,
    )
    module("launch_ros")
    module("launch_ros.actions", Node=record)
    module(
        "launch_ros.parameter_descriptions",
        ParameterValue=lambda value, value_type: value_type(value),
    )
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "rviz2").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))


def started(file: str, **given: str) -> list[Any]:
    """What a launch file starts with these arguments, and the defaults of the others."""
    *arguments, function = runpy.run_path(str(LAUNCH / file))["generate_launch_description"]()
    values = {one.name: one.default_value for one in arguments}
    assert given.keys() <= values.keys()
    context = SimpleNamespace(launch_configurations={**values, **given}, argv=[])
    found: list[Any] = function.function(context)
    return found


def given_parameters(node: Any) -> dict[str, Any]:
    *files, parameters = node.parameters
    assert all(Path(file).is_file() for file in files)
    return dict(parameters)


@pytest.mark.parametrize("file", NODES)
def test_they_start_their_nodes_with_the_model(file: str) -> None:
    nodes = started(file, model="ur5e", namespace="left")
    assert [node.executable for node in nodes] == NODES[file]
    for node in nodes:
        assert (node.package, node.namespace) == ("annik_ros", "left")
        assert given_parameters(node)["model"] == "ur5e"


@pytest.mark.parametrize("file", NODES)
def test_they_show_the_robot_where_asked(file: str) -> None:
    pytest.importorskip("viser", reason="the page needs viser")
    nodes = started(file, model="ur5e", namespace="left", viewer="true", rviz="true")
    assert [node.executable for node in nodes] == [*NODES[file], "viewer", "rviz2"]
    viewer, rviz = nodes[-2:]
    assert given_parameters(viewer)["model"] == "ur5e"
    layout, frame = rviz.arguments[1::2]
    assert Path(layout).is_file() and frame == "base_link"
    assert ("/accepted_target", "accepted_target") in rviz.remappings
    for node in (viewer, rviz):
        assert node.namespace == "left"
        # Who closes a window may want the robot to go on.
        assert (
            node.on_exit(SimpleNamespace(returncode=1), SimpleNamespace(is_shutdown=False)) is None
        )


def test_a_remapped_topic_is_remapped_for_the_page_too() -> None:
    pytest.importorskip("viser", reason="the page needs viser")
    pair = "joint_states:=/arm/joint_states"
    nodes = started("robot.launch.py", model="ur5e", remappings=pair, viewer="true")
    for node in nodes:
        assert node.remappings == [("joint_states", "/arm/joint_states")]


def test_a_wrong_argument_starts_nothing() -> None:
    (end,) = started("annik.launch.py", model="no.onnx")
    assert end.period == 0.0
