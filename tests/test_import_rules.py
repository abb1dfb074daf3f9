"""Who may import whom (docs/architecture.md), found by importing every module alone. ROS-free."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TORCH = {"torch", "onnxscript"}
ROS = {
    "rclpy",
    "geometry_msgs",
    "sensor_msgs",
    "diagnostic_msgs",
    "std_msgs",
    "std_srvs",
    "builtin_interfaces",
    "rcl_interfaces",
    "lifecycle_msgs",
    "trajectory_msgs",
}
SLOW = {"numpy", "scipy.optimize", "scipy.spatial", "matplotlib.pyplot", "onnx", "onnxruntime"}
SLOW |= {"rclpy", "rosbags.typesys", "torch"}
CONVERSIONS = {"cdr", "pose", "joint_state", "joint_trajectory", "stamp", "vector3"}


def modules(package: str) -> list[str]:
    return sorted(f"{package}.{path.stem}" for path in (ROOT / package).glob("[!_]*.py"))


def forbidden(module: str) -> set[str]:
    """What must not be loaded once this module is."""
    package, _, name = module.partition(".")
    ours = {"annik_core", "annik_training", "annik_ros", "msg_tools"}
    if package == "annik_core":
        return TORCH | ROS | (ours - {"annik_core"})
    if package == "annik_training":
        return ROS | {"annik_ros"}
    if package == "msg_tools":
        above = TORCH | {"annik_training", "annik_ros"}
        return above | ({"rclpy"} if name in CONVERSIONS else ROS)
    return TORCH | {"annik_training"}


ALL_MODULES = [
    module
    for package in ("annik_core", "annik_training", "msg_tools", "annik_ros")
    for module in modules(package)
]


def test_every_package_is_looked_at() -> None:
    assert len(ALL_MODULES) > 40


@pytest.mark.parametrize("package", ["annik_core", "annik_training", "msg_tools", "annik_ros"])
def test_importing_a_module_loads_nothing_forbidden(package: str) -> None:
    """One process per package; each module is imported into a fresh set of our modules.

    What all of them may load, and is slow to load, is there already.
    """
    pairs = [(module, sorted(forbidden(module))) for module in modules(package)]
    allowed = sorted(SLOW - set().union(*(names for _, names in pairs)))
    script = (
        "import importlib, os, sys\n"
        f"for library in {allowed!r}:\n"
        "    try: importlib.import_module(library)\n"
        "    except ImportError: pass\n"
        f"for module, forbidden in {pairs!r}:\n"
        "    child = os.fork()\n"
        "    if child == 0:\n"
        "        importlib.import_module(module)\n"
        "        found = sorted(set(forbidden) & set(sys.modules))\n"
        "        if found: print(module, 'loads', ', '.join(found), flush=True)\n"
        "        os._exit(bool(found))\n"
        "    if os.waitpid(child, 0)[1] != 0: print(module, 'failed', flush=True)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert result.stdout == "", result.stdout + result.stderr
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("module", ALL_MODULES)
def test_no_statement_imports_the_forbidden(module: str) -> None:
    """Imports inside functions, which importing the module does not run."""
    source = (ROOT / module.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8")
    imported = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            imported.add(node.module.split(".")[0])
    assert not imported & forbidden(module)


def test_serving_the_gantry_loads_no_library_that_it_can_do_without() -> None:
    """A node is ready the sooner; and nothing is loaded late, while a target waits."""
    script = (
        "import sys, annik_ros.ik_node_parameters\n"
        "from annik_core.ik_server import IkServer\n"
        "from annik_core.ik_solver import IkSolver\n"
        "server = IkServer(IkSolver.from_file('gantry'))\n"
        "pose = server.solver.robot.forward_kinematics.poses("
        "server.solver.robot.joint_box.centre[None])[0]\n"
        "before = set(sys.modules)\n"
        "assert server.answer(pose).accepted\n"
        "print(sorted(set(sys.modules) - before), {'scipy', 'pinocchio'} & set(sys.modules))\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=60
    )
    assert result.stdout == "[] set()\n", result.stdout + result.stderr
