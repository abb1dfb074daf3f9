"""The launch files, with the real launch and its command line where they are installed."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rcl_interfaces.srv import GetParameters
from support.processes import ROOT, Process, is_group_gone, wait_until

# The checkout has a folder of this name too.
pytest.importorskip("launch.actions", reason="launch is not installed: it is in no wheel")
pytest.importorskip("ros2cli.cli", reason="ros2cli is not installed: it is in no wheel")

ROS2 = "import sys; from ros2cli.cli import main; sys.exit(main())"
NODES = ("ik_node", "fake_robot", "target_publisher", "bag_recorder")
READY = "serving "
FILES = ("annik.launch.py", "robot.launch.py", "demo.launch.py")

Starter = Callable[..., Process]


@pytest.fixture
def ros2_launch(domain: int, tmp_path: Path) -> Iterator[Starter]:
    """Start ``ros2 launch FILE NAME:=VALUE ...`` with the checkout's launch files and nodes."""
    prefix = tmp_path / "prefix"
    index = prefix / "share" / "ament_index" / "resource_index" / "packages"
    executables = prefix / "lib" / "annik_ros"
    launch_files = prefix / "share" / "annik_ros" / "launch"
    for folder in (index, executables, launch_files):
        folder.mkdir(parents=True)
    (index / "annik_ros").touch()
    for file in FILES:
        (launch_files / file).symlink_to(ROOT / "launch" / file)
    for name in NODES:
        script = executables / name
        python = shlex.quote(sys.executable)
        script.write_text(f'#!/bin/sh\nexec {python} -m annik_ros.{name}.node "$@"\n')
        script.chmod(0o755)
    paths = {
        "AMENT_PREFIX_PATH": f"{prefix}:{os.environ.get('AMENT_PREFIX_PATH', sys.prefix)}",
        "PYTHONPATH": f"{ROOT}:{os.environ.get('PYTHONPATH', '')}",
    }
    environment = {
        **paths,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_LOG_DIR": str(tmp_path / "log"),
        "PYTHONUNBUFFERED": "1",
    }
    processes: list[Process] = []

    def start(file: str | Path, *arguments: str) -> Process:
        log = tmp_path / f"{len(processes)}.log"
        package = ("annik_ros",) if isinstance(file, str) else ()
        command = (sys.executable, "-c", ROS2, "launch", *package, str(file), *arguments)
        processes.append(Process(*command, log=log, cwd=tmp_path, environment=environment))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        print(process.log)


def ended(process: Process) -> int:
    """The exit code of a launch, none of whose processes is left."""
    code = process.wait_for_exit()
    wait_until(lambda: is_group_gone(process.pid), "the end of all that was started")
    assert "Traceback" not in process.log
    return code


def interrupted(process: Process) -> int:
    process.signal(signal.SIGINT)
    return ended(process)


@pytest.mark.parametrize(
    ("file", "argument", "named"),
    [
        ("demo.launch.py", "rate:=abc", "rate is 'abc'"),
        ("demo.launch.py", "loops:=x", "loops is 'x'"),
        ("demo.launch.py", "path:=spiral", "path is 'spiral'"),
        ("demo.launch.py", "path:=csv", "csv_file is ''"),
        ("demo.launch.py", "bag:=.", "bag is '.'"),
        *((file, "model:=no.onnx", "model is 'no.onnx'") for file in FILES),
        *((file, "namespace:=a-b", "namespace is 'a-b'") for file in FILES),
        *((file, "modle:=ur5e", "'modle'; allowed: model") for file in FILES),
        ("annik.launch.py", "use_sim_time:=perhaps", "use_sim_time is 'perhaps'"),
        ("robot.launch.py", "autostart:=perhaps", "autostart is 'perhaps'"),
        ("robot.launch.py", "params_file:=no.yaml", "params_file is 'no.yaml'"),
        ("robot.launch.py", "log_level:=loud", "log_level is 'loud'"),
        ("robot.launch.py", "remappings:=loud", "remappings is 'loud'"),
        ("robot.launch.py", "namespace:=left", "model is ''"),
    ],
)
def test_a_wrong_argument_starts_nothing(
    ros2_launch: Starter, file: str, argument: str, named: str
) -> None:
    process = ros2_launch(file, argument)
    assert ended(process) == 1
    assert "process started" not in process.log
    (error,) = [line for line in process.log.splitlines() if "[ERROR]" in line]
    assert named in error


@pytest.mark.parametrize("file", FILES)
def test_a_model_that_can_not_be_used_ends_the_launch_at_once(
    ros2_launch: Starter, tmp_path: Path, file: str
) -> None:
    (tmp_path / "junk.onnx").write_bytes(b"junk")
    process = ros2_launch(file, "model:=junk.onnx")
    assert ended(process) == 1
    assert re.search(r"(ik_node|fake_robot|target_publisher) ended with exit code 1", process.log)
    assert "subscribers on" not in process.log


@pytest.mark.parametrize("dead", ["ik_node", "fake_robot"])
@pytest.mark.parametrize("file", FILES)
def test_a_dead_node_ends_the_launch(ros2_launch: Starter, file: str, dead: str) -> None:
    if (file, dead) == ("robot.launch.py", "fake_robot"):
        pytest.skip("a real robot has no fake one")
    # Without end, so that the demo is still running.
    endless = ["loops:=0"] if file == "demo.launch.py" else []
    process = ros2_launch(file, "model:=gantry", *endless)
    process.wait_for_text(READY)
    started = re.search(rf"\[{dead}-\d+\]: process started with pid \[(\d+)\]", process.log)
    assert started is not None
    os.kill(int(started[1]), signal.SIGKILL)
    assert ended(process) == 1
    assert f"{dead} ended with exit code -9" in process.log


@pytest.mark.parametrize(
    "arguments",
    [(), ("path:=circle",), ("model:=ur5e",), ("model:=ur5e", "path:=line", "namespace:=left")],
)
def test_the_demo_drives_every_robot(
    ros2_launch: Starter, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    process = ros2_launch("demo.launch.py", "bag:=bag", *arguments)
    assert ended(process) == 0
    assert "refused" not in process.log
    from msg_tools.bags.reader import read_bag
    from msg_tools.report.tracking import tracking_report

    report = tracking_report(read_bag(tmp_path / "bag"))
    assert (report.targets_sent, len(report.targets), report.targets_refused) == (15, 15, 0)


def test_the_demo_fails_if_targets_are_refused(ros2_launch: Starter, tmp_path: Path) -> None:
    header, good, bad = "x,y,z,qx,qy,qz,qw", "0.3,0.3,0.6,0,0,0,1", "9,9,9,0,0,0,1"
    (tmp_path / "targets.csv").write_text("\n".join([header, good, bad]), encoding="utf-8")
    process = ros2_launch("demo.launch.py", "path:=csv", "csv_file:=targets.csv")
    assert ended(process) == 1
    assert "target refused, outside workspace" in process.log
    assert "of 2 targets only these results came: 1 on /accepted_target" in process.log


PARENT = """
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

def generate_launch_description():
    return LaunchDescription([
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource({file!r}), launch_arguments=arguments.items()
        )
        for arguments in {arguments!r}
    ])
"""


def parent(tmp_path: Path, file: str, *arguments: dict[str, str]) -> Path:
    """A launch file that includes one of annik's several times."""
    path = tmp_path / "parent.launch.py"
    text = PARENT.format(file=str(ROOT / "launch" / file), arguments=arguments)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("file", ["annik.launch.py", "robot.launch.py"])
def test_two_robots_in_one_launch(
    ros2_launch: Starter, make_client: Callable[..., Any], tmp_path: Path, file: str
) -> None:
    models = {"left": "gantry", "right": "ur5e"}
    included = ({"namespace": name, "model": model} for name, model in models.items())
    process = ros2_launch(parent(tmp_path, file, *included))
    process.wait_for_text(READY, count=2)
    for name, model in models.items():
        client = make_client(namespace=name)
        request = GetParameters.Request(names=["model"])
        response = client.request(GetParameters, f"/{name}/ik_node/get_parameters", request)
        assert response.values[0].string_value == model
        client.wait_until(
            lambda client=client: client.target.get_subscription_count() == 1, "its ik_node"
        )
    assert interrupted(process) == 0


def test_a_wrong_second_robot_leaves_nothing_of_the_first(
    ros2_launch: Starter, tmp_path: Path
) -> None:
    included = ({"namespace": "left", "model": "gantry"}, {"namespace": "a-b", "model": "gantry"})
    process = ros2_launch(parent(tmp_path, "annik.launch.py", *included))
    assert ended(process) == 1
    assert "namespace is 'a-b'" in process.log


def test_a_real_robot(ros2_launch: Starter, client: Any, tmp_path: Path) -> None:
    """Every argument reaches the node; what is not given is left to the file."""
    parameters = "{model: ur5e, max_joint_step: 0.5, autostart: false}"
    file = tmp_path / "robot.yaml"
    file.write_text(f"/left/ik_node: {{ros__parameters: {parameters}}}", encoding="utf-8")
    process = ros2_launch(
        "robot.launch.py",
        *("params_file:=robot.yaml", "namespace:=left", "use_sim_time:=true", "log_level:=debug"),
        "remappings:=target_pose:=goal joint_command:=/arm/command",
    )
    process.wait_for_text("unconfigured")
    names = ["model", "max_joint_step", "autostart", "use_sim_time"]
    service = "/left/ik_node/get_parameters"
    values = client.request(GetParameters, service, GetParameters.Request(names=names)).values
    assert [values[0].string_value, values[1].double_value] == ["ur5e", 0.5]
    assert [value.bool_value for value in values[2:]] == [False, True]
    assert client.change_state("/left/ik_node", "configure")
    wait_until(lambda: client.node.count_subscribers("/left/goal") == 1, "the remapped target")
    assert client.node.count_publishers("/arm/command") == 1
    assert "[DEBUG]" in process.log
    assert interrupted(process) == 0


def test_parameters_that_are_meant_for_another_node_are_refused(
    ros2_launch: Starter, tmp_path: Path
) -> None:
    """The limits in the file would silently not hold."""
    file = tmp_path / "robot.yaml"
    file.write_text("ik_node: {ros__parameters: {max_joint_step: 0.1}}", encoding="utf-8")
    arguments = ("model:=ur5e", "params_file:=robot.yaml", "namespace:=left")
    process = ros2_launch("robot.launch.py", *arguments)
    assert ended(process) == 1
    assert "process started" not in process.log
    assert "params_file is 'robot.yaml'" in process.log
