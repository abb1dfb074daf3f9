"""Which package may import which (docs/architecture.md). ROS-free."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

import pytest
from support.processes import LONG_PATIENCE, ROOT, run_python

from annik_core.kernel import compiled_kernel

PACKAGES = ("annik_core", "annik_view", "annik_training", "msg_tools", "annik_ros")
NOT_INSTALLED = {"benchmarks", "examples", "tests", "docs"}
TORCH = {"torch"}
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

#: The rooms of each package, bottom first: a room imports rooms above it in this list only.
LEVELS: Mapping[str, tuple[str, ...]] = {
    "annik_core": (
        "lazy",
        "errors",
        "settings",
        "pose",
        "kernel",
        "files",
        "installation",
        "append_log",
        "target_paths",
        "robots",
        "dataset",
        "safety",
        "model",
        "solver",
        "reachable_paths",
        "serving",
        "simulation",
        "collection",
    ),
    "annik_view": ("skeleton", "shapes", "meshes", "solvers", "state", "server", "page"),
    "annik_training": (
        "errors",
        "networks",
        "joint_box",
        "suggested_box",
        "fitting",
        "defaults",
        "calibration",
        "designs",
        "evaluation",
        "export",
        "training",
        "cli",
    ),
    "msg_tools": ("topics", "conversions", "bags", "report"),
    "annik_ros": (
        "signals",
        "shared_memory",
        "parameters",
        "command_line",
        "declare_parameters",
        "diagnostics",
        "managed_node",
        "qos",
        "measured_joint_positions",
        "processes",
        "throttle",
        "run_node",
        "bag_recorder",
        "example_collector",
        "fake_robot",
        "ik_node",
        "target_publisher",
        "viewer",
        "launch_arguments",
        "launch_actions",
        "main",
        "round_trip",
        "doctor",
    ),
}


def modules(package: str, root: Path = ROOT) -> dict[str, Path]:
    """Every module of a package, of its subpackages too."""
    found = {}
    for path in sorted((root / package).rglob("*.py")):
        name = ".".join(path.relative_to(root).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


ALL_MODULES = {name: path for package in PACKAGES for name, path in modules(package).items()}


def forbidden(module: str) -> set[str]:
    """Top-level packages that must not be loaded once this module is."""
    package, _, rest = module.partition(".")
    if package == "annik_core":
        return NOT_INSTALLED | TORCH | ROS | (set(PACKAGES) - {"annik_core"})
    if package == "annik_view":
        return NOT_INSTALLED | TORCH | ROS | (set(PACKAGES) - {"annik_core", "annik_view"})
    if package == "annik_training":
        return NOT_INSTALLED | ROS | {"annik_ros"}
    if package == "msg_tools":
        above = NOT_INSTALLED | TORCH | {"annik_training", "annik_ros"}
        return above | ({"rclpy"} if rest.startswith("conversions") else ROS)
    return NOT_INSTALLED | TORCH | {"annik_training"}


def imported(source: str) -> set[str]:
    """Modules, and perhaps names in them, that a source imports anywhere, in functions too."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def violations(module: str, source: str) -> set[str]:
    """The forbidden packages that a module's source imports."""
    return {name.partition(".")[0] for name in imported(source)} & forbidden(module)


def imports_within(files: Mapping[str, Path]) -> dict[str, set[str]]:
    """Which of these modules import which others of them."""
    graph = {}
    for module, path in files.items():
        names = imported(path.read_text(encoding="utf-8"))
        owners = {name if name in files else name.rpartition(".")[0] for name in names}
        graph[module] = (owners & set(files)) - {module}
    return graph


def room(module: str) -> str:
    """The subpackage, or the module directly in the package, that a module belongs to."""
    return module.split(".")[1]


def climbs(graph: Mapping[str, Iterable[str]], levels: tuple[str, ...]) -> list[str]:
    """Imports of a room from a level that is not below its own."""
    return [
        f"{module} imports {other}"
        for module, others in graph.items()
        for other in others
        if "." in module
        and "." in other
        and room(module) != room(other)
        and levels.index(room(other)) >= levels.index(room(module))
    ]


def test_every_installed_module_is_looked_at() -> None:
    """Found in another way: what ``setup.py`` installs, and what is in these folders."""
    (installed,) = (
        ast.literal_eval(node.value)
        for node in ast.parse((ROOT / "setup.py").read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "IMPORT_PACKAGES"
    )
    assert set(PACKAGES) == set(installed)
    there = {
        Path(folder, name)
        for package in installed
        for folder, _, names in os.walk(ROOT / package)
        for name in names
        if name.endswith(".py")
    }
    assert set(ALL_MODULES.values()) == there
    assert len(ALL_MODULES) > 150
    assert ALL_MODULES["annik_core.solver.ik_solver"] == ROOT / "annik_core/solver/ik_solver.py"


@pytest.mark.process
@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_module_loads_nothing_forbidden(package: str) -> None:
    """One process per package; each module is imported into a fresh set of the package's modules.

    What else they import, and all of them may load, is there already: it is slow to load.
    """
    pairs = [(module, sorted(forbidden(module))) for module in modules(package)]
    banned = {package}.union(*(names for _, names in pairs))
    others = {
        name
        for path in modules(package).values()
        for name in imported(path.read_text(encoding="utf-8"))
        if name.partition(".")[0] not in banned
    }
    script = (
        "import gc, importlib, os, sys\n"
        f"for other in {sorted(others)!r}:\n"
        "    try: importlib.import_module(other)\n"
        "    except ImportError: pass\n"
        "gc.disable()\n"  # it would copy the memory that a child shares with its parent
        f"for module, forbidden in {pairs!r}:\n"
        "    child = os.fork()\n"
        "    if child == 0:\n"
        "        importlib.import_module(module)\n"
        "        found = sorted(set(forbidden) & set(sys.modules))\n"
        "        if found: print(module, 'loads', ', '.join(found), flush=True)\n"
        "        os._exit(bool(found))\n"
        "    if os.waitpid(child, 0)[1] != 0: print(module, 'failed', flush=True)\n"
    )
    result = run_python("-c", script, patience=LONG_PATIENCE)
    assert result.stdout == "", result.stdout + result.stderr
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("module", ALL_MODULES)
def test_no_statement_imports_the_forbidden(module: str) -> None:
    """Imports inside functions too, which importing the module does not run."""
    assert not violations(module, ALL_MODULES[module].read_text(encoding="utf-8"))


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_make_no_circle(package: str) -> None:
    try:
        TopologicalSorter(imports_within(modules(package))).prepare()
    except CycleError as error:
        pytest.fail(f"import circle: {' -> '.join(error.args[1])}")


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_go_downwards(package: str) -> None:
    files = modules(package)
    assert {room(module) for module in files if "." in module} == set(LEVELS[package])
    assert climbs(imports_within(files), LEVELS[package]) == []


def test_a_forbidden_import_in_a_subpackage_is_found() -> None:
    inside = "def serve():\n    from torch import nn\n"
    assert violations("annik_core.solver.ik_solver", inside) == {"torch"}
    assert violations("annik_training.fitting.fit", "import rclpy.node") == {"rclpy"}
    assert violations("annik_ros.ik_node.node", "from benchmarks.node import run") == {
        "benchmarks"
    }
    assert violations("msg_tools.bags.reader", "import geometry_msgs.msg") == {"geometry_msgs"}


def test_a_climbing_import_and_a_circle_are_found(tmp_path: Path) -> None:
    folder = tmp_path / "annik_core" / "robots"
    folder.mkdir(parents=True)
    (folder / "low.py").write_text("from annik_core.robots import high\n", encoding="utf-8")
    (folder / "high.py").write_text(
        "from annik_core.robots.low import x\nfrom annik_core.solver import result\n",
        encoding="utf-8",
    )
    (tmp_path / "annik_core" / "solver").mkdir()
    (tmp_path / "annik_core" / "solver" / "result.py").touch()
    graph = imports_within(modules("annik_core", tmp_path))
    with pytest.raises(CycleError):
        TopologicalSorter(graph).prepare()
    assert climbs(graph, LEVELS["annik_core"]) == [
        "annik_core.robots.high imports annik_core.solver.result"
    ]


@pytest.mark.process
@pytest.mark.parametrize("model", ["gantry", "ur5e"])
def test_serving_loads_no_library_that_it_can_do_without(model: str) -> None:
    """A node is ready the sooner; and nothing is loaded late, while a target waits."""
    if model == "ur5e" and compiled_kernel() is None:
        pytest.skip("without the compiled kernel SciPy solves for arms")
    module = "annik_ros.ik_node." + ("node" if find_spec("rclpy") else "parameters")
    script = (
        f"import sys, {module}\n"
        "from annik_core.serving.ik_server import IkServer\n"
        "from annik_core.solver.ik_solver import IkSolver\n"
        "server = IkServer(IkSolver.from_file(sys.argv[1]))\n"
        "pose = server.solver.robot.forward_kinematics.poses("
        "server.solver.robot.joint_box.centre[None])[0]\n"
        "before = set(sys.modules)\n"
        "assert server.solve(pose).accepted\n"
        "print(sorted(set(sys.modules) - before), {'scipy', 'pinocchio'} & set(sys.modules))\n"
    )
    result = run_python("-c", script, model)
    assert result.stdout == "[] set()\n", result.stdout + result.stderr
