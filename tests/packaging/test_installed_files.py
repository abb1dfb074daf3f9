"""What a wheel holds, and that it is whole."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.processes import LONG_PATIENCE, ROOT, run_python
from support.source_tree import IMPORT_PACKAGES, SHARED_FOLDERS, copy_of_the_tree

pytestmark = [pytest.mark.process, pytest.mark.slow]

#: Imports every module that is given, and says where from.
IMPORT_ALL = """
import importlib, sys
for name in sys.argv[1:]:
    print(importlib.import_module(name).__file__)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[zipfile.ZipFile]:
    """The wheel of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    tree = copy_of_the_tree(folder / "source")
    command = ("-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder)
    result = run_python(*command, tree, cwd=folder, patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stderr
    (path,) = folder.glob("*.whl")
    with zipfile.ZipFile(path) as wheel:
        yield wheel


def files_below(folder: str) -> set[str]:
    """What a wheel should hold of a package: modules, templates, the mark of types."""
    return {
        str(path.relative_to(ROOT))
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".py", ".jinja") or path.name == "py.typed"
    }


def test_it_holds_the_packages_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    """No tests, benchmarks, examples or documentation."""
    names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    modules = {name for name in names if ".data/" not in name}
    assert modules == set().union(*map(files_below, IMPORT_PACKAGES))
    data = {name.split(".data/data/")[1] for name in names - modules}
    shared = {
        f"share/annik_ros/{path.relative_to(ROOT)}"
        for folder in SHARED_FOLDERS
        for path in (ROOT / folder).iterdir()
        if path.suffix in (".py", ".yaml", ".onnx", ".urdf")
    }
    assert data == {
        *shared,
        "share/annik_ros/package.xml",
        "share/ament_index/resource_index/packages/annik_ros",
    }


def test_every_module_is_imported_from_it(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    """Elsewhere than in the checkout."""
    pytest.importorskip("rclpy")
    pytest.importorskip("torch")
    wheel.extractall(tmp_path / "installed")
    modules = [
        name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        for name in wheel.namelist()
        if name.endswith(".py") and name.split("/")[0] in IMPORT_PACKAGES
    ]
    environment = {"PYTHONPATH": str(tmp_path / "installed")}
    command = ("-c", IMPORT_ALL, *modules)
    result = run_python(*command, cwd=tmp_path, environment=environment, patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stderr
    files = result.stdout.splitlines()
    assert len(files) == len(modules)
    assert all(Path(file).is_relative_to(tmp_path / "installed") for file in files)
    shutil.rmtree(tmp_path / "installed")
