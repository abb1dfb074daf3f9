"""What a wheel holds that is built from a source distribution, and that it is whole."""

from __future__ import annotations

import os
import shutil
import subprocess
import sysconfig
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.processes import LONG_PATIENCE, ROOT, run_python
from support.source_tree import (
    IMPORT_PACKAGES,
    QUICK_BUILD,
    SHARED_FOLDERS,
    copy_of_the_tree,
)

pytestmark = [pytest.mark.process, pytest.mark.slow]

#: Imports every module that is given, and says where from.
IMPORT_ALL = """
import importlib, sys
for name in sys.argv[1:]:
    print(importlib.import_module(name).__file__)
"""


@pytest.fixture(scope="module")
def wheel_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of the source distribution of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    tree = copy_of_the_tree(folder / "source")
    made = run_python("setup.py", "-q", "sdist", "-d", folder, cwd=tree, patience=LONG_PATIENCE)
    assert made.returncode == 0, made.stderr
    (source,) = folder.glob("*.tar.gz")
    command = ("-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", folder)
    result = run_python(
        *(*command, source), cwd=folder, environment=QUICK_BUILD, patience=LONG_PATIENCE
    )
    assert result.returncode == 0, result.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def wheel(wheel_file: Path) -> Iterator[zipfile.ZipFile]:
    """The wheel, open."""
    with zipfile.ZipFile(wheel_file) as wheel:
        yield wheel


KERNEL = f"annik_core/kernel/compiled{sysconfig.get_config_var('EXT_SUFFIX')}"


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
    assert modules == {KERNEL}.union(*map(files_below, IMPORT_PACKAGES))
    data = {name.split(".data/data/")[1] for name in names - modules}
    shared = {
        f"share/annik_ros/{path.relative_to(ROOT)}"
        for folder in SHARED_FOLDERS
        for path in (ROOT / folder).iterdir()
        if path.suffix in (".py", ".yaml", ".onnx", ".urdf", ".rviz", ".json", ".xml")
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


def test_it_solves_ur5e_in_a_clean_environment_with_its_kernel(
    wheel_file: Path, tmp_path: Path
) -> None:
    """Where nothing else is installed than what the wheel asks for."""
    clean = tmp_path / "clean"
    python = clean / "bin" / "python"
    made = run_python("-m", "venv", "--without-pip", clean)
    assert made.returncode == 0, made.stderr
    pip = ("-m", "pip", "--python", python, "install", "-q", "-c", ROOT / "constraints.txt")
    installed = run_python(*pip, wheel_file, cwd=tmp_path, patience=LONG_PATIENCE)
    if "from versions: none" in installed.stderr:
        pytest.skip("pip reaches no package index")
    assert installed.returncode == 0, installed.stderr
    solved = subprocess.run(
        [python, ROOT / "tests" / "packaging" / "solve_ur5e.py"],
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
        timeout=LONG_PATIENCE,
        check=False,
    )
    assert solved.returncode == 0, solved.stderr
    assert Path(solved.stdout.strip()).is_relative_to(clean)


def test_without_a_compiler_it_is_built_without_the_kernel_and_says_so(tmp_path: Path) -> None:
    tree = copy_of_the_tree(tmp_path / "source")
    environment = {"CC": "no-such-compiler", "CXX": "no-such-compiler"}
    result = run_python("setup.py", "-q", "build", cwd=tree, environment=environment)
    assert result.returncode == 0, result.stderr
    assert "the kernel could not be compiled" in result.stderr
    built = tree / "build"
    assert list(built.glob("*/annik_core/kernel/__init__.py"))
    assert not list(built.rglob("compiled*.so"))
