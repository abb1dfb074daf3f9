"""The package as a ROS user builds it with colcon, plain and symlinked, and the nodes in it."""

import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = [pytest.mark.colcon, pytest.mark.ros, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
EXECUTABLES = {
    "annik",
    "bag_recorder",
    "example_collector",
    "fake_robot",
    "ik_node",
    "target_publisher",
}
SHARED_FOLDERS = ("config", "launch", "models", "robots")

BUILD_TIMEOUT = 120.0  # [s]
START_TIMEOUT = 30.0  # [s]
STOP_TIMEOUT = 5.0  # [s]

DOMAINS = 102  # ROS domains that every platform supports: 0 to 101


@pytest.fixture(scope="module", params=["plain", "symlink"])
def workspace(request, tmp_path_factory):
    """A colcon workspace that holds a copy of this checkout, built."""
    workspace = tmp_path_factory.mktemp(request.param)
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    patterns = [line.rstrip("/") for line in ignored if line and not line.startswith("#")]
    shutil.copytree(
        ROOT, workspace / "src" / "annik_ros", ignore=shutil.ignore_patterns(".git", *patterns)
    )
    options = ["--symlink-install"] if request.param == "symlink" else []
    subprocess.run(
        [sys.executable, "-m", "colcon", "build", "--event-handlers", "console_direct+", *options],
        cwd=workspace,
        env=environment(),
        timeout=BUILD_TIMEOUT,
        check=True,
    )
    return workspace


def test_executables_are_where_ros2_run_looks(workspace) -> None:
    folder = workspace / "install" / "annik_ros" / "lib" / "annik_ros"
    assert {path.name for path in folder.iterdir() if os.access(path, os.X_OK)} == EXECUTABLES


def test_scripts_find_their_interpreter_at_run_time(workspace) -> None:
    script = workspace / "install" / "annik_ros" / "lib" / "annik_ros" / "ik_node"
    first_line = script.read_text(encoding="utf-8").splitlines()[0]
    assert first_line in ("#!/usr/bin/env python3", f"#!{sys.executable}")


@pytest.mark.parametrize("folder", SHARED_FOLDERS)
def test_shared_files_are_installed(workspace, folder) -> None:
    def names(path):
        return {file.name for file in path.iterdir() if file.suffix in (".py", ".yaml", ".onnx")}

    installed = names(workspace / "install" / "annik_ros" / "share" / "annik_ros" / folder)
    assert installed == names(ROOT / folder)
    assert installed


def test_package_is_in_the_ament_index(workspace) -> None:
    install = workspace / "install" / "annik_ros"
    assert (install / "share" / "annik_ros" / "package.xml").is_file()
    assert (install / "share/ament_index/resource_index/packages/annik_ros").is_file()


def test_installed_code_finds_its_own_shared_files(workspace) -> None:
    found = in_workspace(
        workspace,
        "python3 -c 'from annik_core.installation import share_directory as d; print(d())'",
        capture_output=True,
        text=True,
        check=True,
        timeout=START_TIMEOUT,
    ).stdout.strip()
    if workspace.name.startswith("plain"):
        assert Path(found) == workspace / "install" / "annik_ros" / "share" / "annik_ros"
    else:
        assert Path(found) == workspace / "src" / "annik_ros"


@pytest.mark.parametrize("executable", ["ik_node", "fake_robot"])
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM], ids=lambda stop: stop.name)
def test_node_runs_from_the_workspace(workspace, executable, stop) -> None:
    node = start_in_workspace(workspace, f"exec install/annik_ros/lib/annik_ros/{executable}")
    try:
        assert f"[{executable}]" in first_line_of_log(node)
        os.killpg(node.pid, stop)
        rest, _ = node.communicate(timeout=STOP_TIMEOUT)
        assert node.returncode == 0, rest
        assert "Traceback" not in rest
    finally:
        if node.poll() is None:
            os.killpg(node.pid, signal.SIGKILL)
            node.communicate()


def environment() -> dict[str, str]:
    """The environment of a terminal with the interpreter's virtual environment active."""
    # A sourced workspace that already has annik would hide the one under test.
    dropped = ("PYTHONPATH", "AMENT_PREFIX_PATH") if "ROS_DISTRO" not in os.environ else ()
    kept = {name: value for name, value in os.environ.items() if name not in dropped}
    prefixes = [kept.get("AMENT_PREFIX_PATH"), sys.prefix]
    return {
        **kept,
        "AMENT_PREFIX_PATH": os.pathsep.join(prefix for prefix in prefixes if prefix),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{kept['PATH']}",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": str(os.getpid() % DOMAINS),
    }


def sourced(workspace, command):
    """The command line that runs a command in a workspace after sourcing it, as a user does."""
    setup = shlex.quote(str(workspace / "install" / "local_setup.bash"))
    return ["bash", "-c", f"source {setup} && {command}"]


def in_workspace(workspace, command, **options):
    """Run a command in the sourced workspace."""
    return subprocess.run(sourced(workspace, command), cwd=workspace, env=environment(), **options)


def start_in_workspace(workspace, command):
    """Start a command in the sourced workspace, in a process group of its own."""
    return subprocess.Popen(
        sourced(workspace, command),
        cwd=workspace,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )


def first_line_of_log(node):
    """The first line that a node logs, which it does when it is ready."""
    deadline = time.monotonic() + START_TIMEOUT
    os.set_blocking(node.stdout.fileno(), False)
    text = ""
    while "[INFO]" not in text:
        assert node.poll() is None, f"ended with {node.returncode}: {text}"
        assert time.monotonic() < deadline, f"no line in {START_TIMEOUT} s: {text}"
        text += node.stdout.readline() or ""
        time.sleep(0.02)
    os.set_blocking(node.stdout.fileno(), True)
    return text
