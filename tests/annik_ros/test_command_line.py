"""What a node makes of its command line, apart from what ROS reads. Needs no ROS."""

from __future__ import annotations

import pytest

from annik_core.errors import AnnikError, missing_dependency
from annik_ros.command_line import (
    UnknownArgument,
    asks_for_help,
    check_arguments,
    help_text,
)
from annik_ros.ik_node.parameters import IkNodeParameters
from docs.parameter_tables import PARAMETER_TABLES

FOR_ROS = ("--ros-args", "-p", "model:=ur5e", "-r", "__ns:=/a", "--log-level", "debug", "-e", "/e")


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (("model:=ur5e",), "--ros-args -p model:=ur5e"),
        (("joint_command:=/arm/command",), "--ros-args -r joint_command:=/arm/command"),
        (("__ns:=/cell",), "--ros-args -r __ns:=/cell"),
        (("--model", "ur5e"), "--ros-args -p model:=ur5e"),
        (("--queue-depth=3",), "--ros-args -p queue_depth:=3"),
        (("-p", "model:=ur5e"), "--ros-args before -p"),
        (("--params-file", "x.yaml"), "--ros-args before --params-file"),
        (("ur5e",), "--ros-args -p NAME:=VALUE"),
        ((*FOR_ROS, "--", "ur5e"), "--ros-args -p NAME:=VALUE"),
        (("--", "ur5e"), "--ros-args -p NAME:=VALUE"),
        (("ur5e", *FOR_ROS), "--ros-args -p NAME:=VALUE"),
    ],
)
def test_what_ros_would_ignore_is_an_error_that_says_what_to_write(
    arguments: tuple[str, ...], remedy: str
) -> None:
    with pytest.raises(UnknownArgument) as caught:
        check_arguments(arguments)
    assert caught.value.argument in arguments
    assert caught.value.argument not in FOR_ROS or "--ros-args" not in arguments
    assert remedy in caught.value.remedy


@pytest.mark.parametrize(
    "arguments", [(), FOR_ROS, (*FOR_ROS, "--"), (*FOR_ROS, "--", *FOR_ROS), ("--ros-args",)]
)
def test_what_is_for_ros_is_left_to_it(arguments: tuple[str, ...]) -> None:
    check_arguments(arguments)
    assert not asks_for_help(arguments)


@pytest.mark.parametrize("arguments", [("-h",), ("--help",), ("--ros-args", "--help")])
def test_help_is_asked_for_anywhere(arguments: tuple[str, ...]) -> None:
    assert asks_for_help(arguments)


def test_help_lists_every_parameter_and_topic() -> None:
    text = help_text("ik_node", "Its purpose.", IkNodeParameters)
    for row in PARAMETER_TABLES["ik_node"]:
        assert f"\n  {row.name} (default " in text
        assert row.allowed in text
    received, _, published = text.partition("publishes:")
    assert "target_poses (geometry_msgs/msg/PoseArray)" in received
    assert "joint_states (sensor_msgs/msg/JointState)" in received
    assert "joint_command (sensor_msgs/msg/JointState)" in published
    assert "achieved_pose" not in text
    assert "Its purpose." in text


@pytest.mark.parametrize(
    ("library", "remedy"),
    [
        ("mcap", "pip install 'annik_ros[serve]'"),
        ("onnxruntime.capi", "pip install onnxruntime"),
        ("geometry_msgs.msg", "source /opt/ros/jazzy/setup.bash"),
        ("rclpy", "source /opt/ros/jazzy/setup.bash"),
        ("yaml", "apt install python3-yaml"),
    ],
)
def test_a_missing_library_is_named_with_what_to_install(library: str, remedy: str) -> None:
    missing = missing_dependency(ModuleNotFoundError("No module", name=library), "ik_node")
    assert missing.library == library.partition(".")[0]
    assert remedy in missing.remedy
    broken = missing_dependency(ImportError("libx.so: no\nsuch file", name=library), "ik_node")
    assert "libx.so: no such file" in broken.remedy
    assert isinstance(broken, AnnikError)


def test_a_missing_module_of_annik_is_a_fault_of_annik() -> None:
    with pytest.raises(ImportError):
        missing_dependency(ImportError("cannot import", name="annik_core.pose"), "ik_node")
