"""The process of a node: its command line, missing libraries, and signals at any moment.

``ANNIK_STARTS=200`` is how many starts get a signal.
"""

from __future__ import annotations

import itertools
import os
import random
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from std_srvs.srv import Trigger
from support.processes import ROOT, Process, wait_until

from annik_ros.declare_parameters import OF_OTHER_NODES, meant_parameter
from annik_ros.shared_memory import FOLDER
from docs.parameter_tables import PARAMETER_TABLES

NODES = tuple(PARAMETER_TABLES)


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Callable[..., Process]]:
    """Start a node as its console script does, with a whole command line."""
    started: list[Process] = []

    def start(node: str, *arguments: str, code: str | None = None) -> Process:
        command = ["-c", code] if code else ["-m", "annik_ros.main", node]
        # Two bags of one second would have one name.
        folder = tmp_path / str(len(started))
        folder.mkdir()
        process = Process(
            *(sys.executable, *command, *arguments),
            log=tmp_path / f"{len(started)}_{node}.log",
            cwd=folder,
            environment={"ROS_DOMAIN_ID": str(domain), "PYTHONPATH": str(ROOT)},
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()


class TestParameterNames:
    """What is nearly a parameter is one that somebody meant."""

    @pytest.mark.parametrize(
        ("given", "meant"),
        [
            ("max_joint_stp", "max_joint_step"),
            ("modle", "model"),
            ("Model", "model"),
            ("MODEL", "model"),
            ("model_", "model"),
            ("mdoe", "mode"),
            ("max-joint-step", "max_joint_step"),
            ("maxjointstep", "max_joint_step"),
            ("max_joint_steps", "max_joint_step"),
            ("joint_step", "max_joint_step"),
            ("measurment_timeout", "measurement_timeout"),
            ("max_jont_steps", "max_joint_step"),
            ("first_comand", "first_command"),
            ("workspace_lower", "workspace_box_lower"),
            ("sue_sim_time", "use_sim_time"),
        ],
    )
    def test_the_right_name_is_found(self, given: str, meant: str) -> None:
        names = {row.name for row in PARAMETER_TABLES["ik_node"]} | {"use_sim_time"}
        assert meant_parameter(given, names) == meant

    @pytest.mark.parametrize("node", NODES)
    @pytest.mark.parametrize(
        "other", ["update_rate", "robot_name", "joints", "gain", "publish_frequency", "tip_link"]
    )
    def test_the_parameters_of_others_are_none(self, node: str, other: str) -> None:
        assert meant_parameter(other, {row.name for row in PARAMETER_TABLES[node]}) is None

    def test_nodes_of_annik_may_share_a_file(self) -> None:
        for one, other in itertools.permutations(NODES, 2):
            names = {row.name for row in PARAMETER_TABLES[one]}
            foreign = {row.name for row in PARAMETER_TABLES[other]} - names - OF_OTHER_NODES
            assert not [name for name in foreign if meant_parameter(name, names)], (one, other)


@pytest.mark.parametrize(
    ("node", "given", "meant"),
    [
        ("ik_node", "max_joint_stp:=0.1", "max_joint_step"),
        ("fake_robot", "modle:=ur5e", "model"),
        ("target_publisher", "Rate:=5.0", "rate"),
        ("bag_recorder", "outptu:=bag", "output"),
        ("viewer", "prot:=8081", "port"),
        ("example_collector", "max_velocity:=0.1", "max_joint_velocity"),
    ],
)
def test_a_misspelt_parameter_ends_the_node_and_names_the_right_one(
    start: Callable[..., Process], tmp_path: Path, node: str, given: str, meant: str
) -> None:
    process = start(node, "--ros-args", "-p", given)
    assert process.wait_for_exit() == 1
    (line,) = process.log.splitlines()
    assert "[FATAL]" in line
    assert repr(given.partition(":=")[0]) in line
    assert repr(meant) in line
    assert not list(tmp_path.glob("bag*"))


def test_what_others_have_is_one_line_and_an_integer_is_a_number(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """A shared file, as for several nodes of a robot."""
    file = tmp_path / "shared.yaml"
    file.write_text(
        "/**: {ros__parameters: {update_rate: 100, gains: {p: 1.0}, mode: refined, "
        "max_joint_step: 1, workspace_box_lower: [-2, -2, -2]}}",
        encoding="utf-8",
    )
    node = launch("ik_node", "--params-file", str(file))
    robot = launch("fake_robot", "--params-file", str(file))
    for process, ignored in ((node, "gains.p, update_rate"), (robot, "gains.p, max_joint_step")):
        (line,) = (line for line in process.log.splitlines() if "ignored" in line)
        assert ignored in line
    assert client.set_parameter("ik_node", "max_joint_step", 2).successful
    assert client.set_parameter("ik_node", "workspace_box_lower", [-3, -3, -3]).successful


@pytest.mark.skipif(not FOLDER.is_dir(), reason="no shared memory in files")
def test_what_a_killed_process_left_half_made_does_not_hold_a_node_up(
    launch: Callable[..., Any], domain: int
) -> None:
    """A node that opens the port of its middleware would wait for ever, and print nothing."""
    first = 7400 + 250 * domain + 11
    left = [FOLDER / f"fastrtps_port{first + 2 * number}" for number in range(4)]
    for path in left:
        path.write_bytes(b"")
        os.utime(path, (0.0, 0.0))
    node = launch("ik_node")
    removed = [line for line in node.log.splitlines() if "half made" in line]
    assert all("[WARN]" in line for line in removed)
    assert len(removed) == len(left)


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (("model:=ur5e",), "--ros-args -p model:=ur5e"),
        (("--model", "ur5e"), "--ros-args -p model:=ur5e"),
        (("ur5e", "--ros-args", "-p", "max_joint_step:=1"), "--ros-args -p NAME:=VALUE"),
    ],
)
@pytest.mark.parametrize("node", NODES[:2])
def test_an_argument_that_nobody_reads_ends_the_node(
    start: Callable[..., Process], node: str, arguments: tuple[str, ...], remedy: str
) -> None:
    process = start(node, *arguments)
    assert process.wait_for_exit() == 1
    (line,) = process.log.splitlines()
    assert remedy in line


@pytest.mark.parametrize("node", NODES)
def test_help_lists_the_parameters_and_starts_nothing(
    start: Callable[..., Process], node: str
) -> None:
    process = start(node, "--help")
    assert process.wait_for_exit() == 0
    assert all(f"\n  {row.name} (default " in process.log for row in PARAMETER_TABLES[node])
    assert "[INFO]" not in process.log


@pytest.mark.parametrize(
    ("node", "library", "remedy"),
    [
        ("ik_node", "onnxruntime", "pip install onnxruntime"),
        ("fake_robot", "rclpy", "source /opt/ros/jazzy/setup.bash"),
        ("fake_robot", "yaml", "pip install pyyaml"),
        ("bag_recorder", "mcap", "pip install 'annik_ros[serve]'"),
        ("bag_recorder", "rosbags", "pip install 'annik_ros[serve]'"),
        ("ik_node", "geometry_msgs", "source /opt/ros/jazzy/setup.bash"),
    ],
)
def test_a_missing_library_is_one_line(
    start: Callable[..., Process], node: str, library: str, remedy: str
) -> None:
    code = (
        f"import sys; sys.modules[{library!r}] = None\n"
        f"from annik_ros.main import run; sys.exit(run({node!r}))"
    )
    process = start(node, code=code)
    assert process.wait_for_exit() == 1
    (line,) = process.log.splitlines()
    assert library in line
    assert remedy in line


#: What Python prints of a SIGINT that it loses in a callback, before our code takes signals.
LOST = re.compile(r"Exception ignored in: .*\n(Traceback .*\n(  .*\n)+)?KeyboardInterrupt: ?\n")
#: A frame of ours, other than those of the modules that are loaded until signals wait.
OURS = re.compile(r'/annik_ros/(?!(__init__|main)\.py", line \d+, in <module>)')


def _check_end(process: Process, *sent: signal.Signals) -> None:
    """One line and exit code 0, or what Python does with a signal before it is at our code."""
    wait_until(lambda: not process.is_running or LOST.match(process.log), "the end", 60.0)
    if process.is_running:
        # Nothing is left of a lost signal; who waits in vain sends it again.
        process.signal(sent[0])
    code, log = process.wait_for_exit(60.0), process.log
    lost = LOST.match(log)
    if lost:
        assert signal.SIGINT in sent and not OURS.search(lost[0]), log
        log = log[lost.end() :]
    if code != 0:
        assert -code in sent or (code, sent[0]) == (1, signal.SIGINT), log
        assert "[INFO]" not in log and not OURS.search(log), log
        if code == -signal.SIGTERM:
            assert log == "", log
        elif code == 1:
            assert log.startswith("Fatal Python error: init_import_site"), log
        assert not log or log.rstrip().endswith("KeyboardInterrupt"), log
        return
    assert "Traceback" not in log
    last = log.splitlines()[-1]
    assert "ended by SIG" in last or "recorded 0 messages" in last, log


def test_the_node_that_joins_first_is_gone_when_its_process_serves(
    start: Callable[..., Process], client: Any
) -> None:
    start("ik_node").wait_for_text("serving ")
    names = client.node.get_node_names
    client.wait_until(lambda: "ik_node" in names() and "_early" not in names(), "the node alone")


@pytest.mark.slow
def test_signals_at_any_moment_are_one_line_and_exit_code_0(
    start: Callable[..., Process],
) -> None:
    """One or two, while it imports, starts, serves or ends."""
    draw = random.Random(13)
    kinds = itertools.cycle(
        itertools.product(
            ("ik_node", "fake_robot", "target_publisher", "bag_recorder"),
            ((signal.SIGINT,), (signal.SIGINT, signal.SIGINT), (signal.SIGTERM,)),
        )
    )
    for node, numbers in itertools.islice(kinds, int(os.environ.get("ANNIK_STARTS", "24"))):
        process = start(node)
        for number, longest in zip(numbers, (3.0, 0.5), strict=False):
            time.sleep(draw.uniform(0.0, longest))
            if process.is_running:
                process.signal(number)
        _check_end(process, *numbers)


def test_a_signal_that_was_ignored_at_the_start_stays_so(start: Callable[..., Process]) -> None:
    """As a script's ``ik_node &``: a Ctrl-C for the script is not for the node."""
    code = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "from annik_ros.main import run; sys.exit(run('ik_node'))"
    )
    process = start("ik_node", code=code)
    process.wait_for_text("serving ")
    process.signal(signal.SIGINT)
    time.sleep(1.0)
    assert process.is_running
    process.signal(signal.SIGTERM)
    _check_end(process, signal.SIGTERM)
    assert "ended by SIGTERM" in process.log


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_reload_from_a_disk_that_hangs_does_not_hold_the_end_up(
    start: Callable[..., Process], client: Any, number: signal.Signals
) -> None:
    code = (
        "import sys, threading\n"
        "from annik_core.model import artifact\n"
        "from annik_ros.main import run\n"
        "read, calls = artifact.read_model_file, []\n"
        "def hang(path):\n"
        "    calls.append(path)\n"
        "    if len(calls) > 1:\n"
        "        print('hangs', flush=True)\n"
        "        threading.Event().wait()\n"
        "    return read(path)\n"
        "artifact.read_model_file = hang\n"
        "sys.exit(run('ik_node'))"
    )
    process = start("ik_node", code=code)
    process.wait_for_text("serving ")
    reload = client.node.create_client(Trigger, "ik_node/reload_model")
    client.wait_until(reload.service_is_ready, "the service")
    reload.call_async(Trigger.Request())
    client.wait_until(lambda: "hangs" in process.log, "the reload")
    process.signal(number)
    assert process.wait_for_exit() == 0
    assert f"ended by {number.name}" in process.log
