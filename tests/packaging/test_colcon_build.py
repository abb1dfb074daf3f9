"""The package as a ROS user builds and tests it with colcon, and the nodes in it."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest
from support.nodes import READY_TEXTS
from support.processes import LONG_PATIENCE, ROOT, Process, run_python
from support.source_tree import QUICK_BUILD, SHARED_FOLDERS, copy_of_the_tree, source_distribution

from examples.demonstration import reserved_domain

pytestmark = [pytest.mark.colcon, pytest.mark.process, pytest.mark.ros, pytest.mark.slow]

EXECUTABLES = {
    "annik",
    "bag_recorder",
    "example_collector",
    "fake_robot",
    "ik_node",
    "target_publisher",
    "viewer",
}

#: A plug-in of pytest that ends it, under the names of those that Jazzy installs.
BROKEN_PLUGINS = ("launch_testing", "launch_ros", "launch_pytest")
#: Enough to see what is run and what is not: the tests of one folder need processes.
TESTED = ("tests/annik_ros", "tests/core/solver/test_ik_solver.py", "tests/integration")


@dataclass(frozen=True)
class Workspace:
    """A colcon workspace that holds annik, built: its source distribution, or this checkout.

    Attributes:
        path: its folder.
        environment: of a terminal in which the virtual environment is active.
    """

    path: Path
    environment: dict[str, str]

    @property
    def install(self) -> Path:
        """Where the package is installed."""
        return self.path / "install" / "annik_ros"

    def sourced(self, command: str) -> tuple[str, ...]:
        """The command line that runs a command after sourcing the workspace, as a user does."""
        setup = shlex.quote(str(self.path / "install" / "local_setup.bash"))
        return ("bash", "-c", f"source {setup} && {command}")


@pytest.fixture(scope="module", params=["plain", "symlink"])
def workspace(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Workspace]:
    path = tmp_path_factory.mktemp(request.param)
    if request.param == "symlink":
        copy_of_the_tree(path / "src" / "annik_ros")
    else:
        made = source_distribution(tmp_path_factory.mktemp("distribution"))
        shutil.unpack_archive(made, path / "src")
    options = ["--symlink-install"] if request.param == "symlink" else []
    with reserved_domain() as domain:
        workspace = Workspace(path, {**environment(), "ROS_DOMAIN_ID": str(domain)})
        command = ("-m", "colcon", "build", "--event-handlers", "console_direct+", *options)
        result = run_python(
            *command,
            cwd=path,
            environment={**workspace.environment, **QUICK_BUILD},
            patience=LONG_PATIENCE,
        )
        assert result.returncode == 0, result.stdout + result.stderr
        yield workspace


def environment() -> dict[str, str]:
    """What is different in a terminal with the interpreter's virtual environment active."""
    # A sourced workspace that already has annik would hide the one under test.
    sourced = "ROS_DISTRO" in os.environ
    prefixes = [os.environ.get("AMENT_PREFIX_PATH", "") if sourced else "", sys.prefix]
    return {
        "AMENT_PREFIX_PATH": os.pathsep.join(prefix for prefix in prefixes if prefix),
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.environ.get("PYTHONPATH", "") if sourced else "",
    }


def test_executables_are_where_ros2_run_looks(workspace: Workspace) -> None:
    folder = workspace.install / "lib" / "annik_ros"
    assert {path.name for path in folder.iterdir() if os.access(path, os.X_OK)} == EXECUTABLES


def test_scripts_find_their_interpreter_at_run_time(workspace: Workspace) -> None:
    script = workspace.install / "lib" / "annik_ros" / "ik_node"
    first_line = script.read_text(encoding="utf-8").splitlines()[0]
    assert first_line in ("#!/usr/bin/env python3", f"#!{sys.executable}")


@pytest.mark.parametrize("folder", SHARED_FOLDERS)
def test_shared_files_are_installed(workspace: Workspace, folder: str) -> None:
    def names(path: Path) -> set[str]:
        return {file.name for file in path.iterdir() if file.suffix in (".py", ".yaml", ".onnx")}

    installed = names(workspace.install / "share" / "annik_ros" / folder)
    assert installed == names(ROOT / folder)
    assert installed


def test_package_is_in_the_ament_index(workspace: Workspace) -> None:
    assert (workspace.install / "share" / "annik_ros" / "package.xml").is_file()
    assert (workspace.install / "share/ament_index/resource_index/packages/annik_ros").is_file()


def test_installed_code_finds_its_own_shared_files(workspace: Workspace, tmp_path: Path) -> None:
    code = "from annik_core.installation import share_directory as d; print(d())"
    command = workspace.sourced(f"python3 -c {shlex.quote(code)}")
    log = tmp_path / "python.log"
    process = Process(*command, log=log, cwd=workspace.path, environment=workspace.environment)
    assert process.wait_for_exit() == 0, process.log
    if workspace.path.name.startswith("plain"):
        expected = workspace.install / "share" / "annik_ros"
    else:
        expected = workspace.path / "src" / "annik_ros"
    assert Path(process.log.strip()) == expected


def test_it_serves_ur5e_with_its_kernel(workspace: Workspace, tmp_path: Path) -> None:
    """Solved in the kernel of the workspace, and by its ik_node."""
    script = ROOT / "tests" / "packaging" / "solve_ur5e.py"
    serve = (
        "from annik_core.installation import model_path as path; "
        "from annik_ros.round_trip import round_trip; assert round_trip(path('ur5e'))"
    )
    command = f"python3 {shlex.quote(str(script))} && python3 -c {shlex.quote(serve)}"
    log = tmp_path / "ur5e.log"
    environment = workspace.environment
    process = Process(*workspace.sourced(command), log=log, environment=environment, cwd=tmp_path)
    try:
        assert process.wait_for_exit(LONG_PATIENCE) == 0, process.log
    finally:
        process.kill()
    kernel = Path(process.log.splitlines()[0])
    assert kernel.resolve().is_relative_to(workspace.path.resolve())


@pytest.mark.parametrize("executable", ["ik_node", "fake_robot"])
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM], ids=lambda stop: stop.name)
def test_node_runs_from_the_workspace(
    workspace: Workspace, executable: str, stop: signal.Signals, tmp_path: Path
) -> None:
    command = workspace.sourced(f"exec install/annik_ros/lib/annik_ros/{executable}")
    log = tmp_path / f"{executable}.log"
    node = Process(*command, log=log, cwd=workspace.path, environment=workspace.environment)
    try:
        node.wait_for_text(READY_TEXTS[executable])
        assert f"[{executable}]" in node.log
        node.signal_group(stop)
        assert node.wait_for_exit() == 0, node.log
        assert "Traceback" not in node.log
    finally:
        node.kill()


def test_colcon_test_runs_the_quick_tests_whatever_plugins_are_installed(
    workspace: Workspace, tmp_path: Path
) -> None:
    """And reports how many; Jazzy's own plug-ins do not go with every pytest."""
    if workspace.path.name.startswith("plain"):
        pytest.skip("a source distribution has no tests")
    (tmp_path / "broken_plugin.py").write_text("raise SystemExit('a plug-in was loaded')\n")
    for name in BROKEN_PLUGINS:
        information = tmp_path / f"{name}_plugin-1.0.dist-info"
        information.mkdir()
        metadata = f"Metadata-Version: 2.1\nName: {name}-plugin\nVersion: 1.0\n"
        (information / "METADATA").write_text(metadata)
        (information / "entry_points.txt").write_text(f"[pytest11]\n{name} = broken_plugin\n")
    python_path = [workspace.environment["PYTHONPATH"], str(tmp_path)]
    result = run_python(
        *("-m", "colcon", "test", "--return-code-on-test-failure", "--pytest-args", *TESTED),
        cwd=workspace.path,
        environment={
            **workspace.environment,
            "PYTHONPATH": os.pathsep.join(filter(None, python_path)),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "",
        },
        patience=LONG_PATIENCE,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    report = ElementTree.parse(workspace.path / "build" / "annik_ros" / "pytest.xml")
    cases = {f"{case.get('classname')}.{case.get('name')}" for case in report.iter("testcase")}
    assert len(cases) > 100
    assert any("test_ik_solver" in case for case in cases)
    assert not any("test_tracking." in case for case in cases)
    summary = run_python("-m", "colcon", "test-result", "--all", cwd=workspace.path)
    assert f"{len(cases)} tests, 0 errors, 0 failures" in summary.stdout
