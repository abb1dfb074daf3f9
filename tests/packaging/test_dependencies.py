"""Every library that is imported is a dependency in package.xml and in setup.py."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path
from xml.etree import ElementTree

import pytest
from packaging.specifiers import SpecifierSet
from support.processes import ROOT
from support.source_tree import IMPORT_PACKAGES

#: The keys by which rosdep knows them; a package of ROS is its own key.
ROSDEP_KEYS = {
    "click": "python3-click",
    "google": "python3-protobuf",
    "jinja2": "python3-jinja2",
    "lz4": "mcap-ros2-support",
    "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support",
    "mpl_toolkits": "python3-matplotlib",
    "numpy": "python3-numpy",
    "onnxruntime": "python3-onnxruntime-pip",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
    "zstandard": "mcap-ros2-support",
}
#: Without a key, or for training only: package.xml says to get them by pip.
FOR_TRAINING = {"onnx", "sympy", "threadpoolctl", "torch"}
BY_PIP = FOR_TRAINING | {"plotly", "trimesh", "viser", "websockets"}
#: Their names at PyPI, where those differ.
DISTRIBUTIONS = {
    "google": "protobuf",
    "mpl_toolkits": "matplotlib",
    "pinocchio": "pin",
    "yaml": "pyyaml",
}
#: Installed with a ROS 2, or by the extra ``ros``; no wheel has the launch system.
ROS = re.compile(r"(.*_(msgs|srvs|interfaces)|rclpy|launch|launch_ros)$")


@pytest.fixture(scope="module")
def libraries() -> dict[str, Path]:
    """The libraries that the installed code imports, each with a file that does."""
    return {
        name: path
        for package in (*IMPORT_PACKAGES, "launch")
        for path in (ROOT / package).rglob("*.py")
        for name in imported_by(path)
    }


def imported_by(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [str(node.module)]
        for name in names:
            library = name.split(".")[0]
            if library not in sys.stdlib_module_names and library not in IMPORT_PACKAGES:
                yield library


def test_package_xml_has_them(libraries: dict[str, Path]) -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = {element.text for element in package.findall("exec_depend")}
    assert not BY_PIP & set(ROSDEP_KEYS)
    assert {
        library: path
        for library, path in libraries.items()
        if library not in BY_PIP and ROSDEP_KEYS.get(library, library) not in keys
    } == {}


def test_setup_py_has_them(libraries: dict[str, Path]) -> None:
    names = {re.split(r"[^\w-]", entry)[0].lower() for entry in requires("annik_ros") or ()}
    assert {
        library: path
        for library, path in libraries.items()
        if not ROS.match(library) and DISTRIBUTIONS.get(library, library) not in names
    } == {}


def test_package_xml_depends_on_nothing_that_is_not_used(libraries: dict[str, Path]) -> None:
    """Besides what starts the launch files, and what is imported by its name where it is there."""
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    keys = {element.text for element in package.findall("exec_depend")}
    used = {ROSDEP_KEYS.get(library, library) for library in libraries}
    assert keys - used == {"ros2launch", "tf2_msgs", "tf2_ros_py"}


def test_pinned_versions_are_for_every_python() -> None:
    """Of what is installed: a pin without a condition on Python holds for 3.10 too."""
    pins = re.findall(r"^([\w.-]+)==\S+$", (ROOT / "constraints.txt").read_text(), flags=re.M)
    wrong = {}
    for name in pins:
        with suppress(PackageNotFoundError):
            allowed = metadata(name).get("Requires-Python") or ""
            if not SpecifierSet(allowed).contains("3.10.0"):
                wrong[name] = allowed
    assert len(pins) > 100
    assert wrong == {}
