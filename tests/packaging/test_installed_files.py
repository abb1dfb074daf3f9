"""What a wheel holds that is built from a source distribution, and that it is whole."""

from __future__ import annotations

import re
import shutil
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
    source_distribution,
)

from benchmarks.install import (
    LEAN,
    MODEL,
    SERVE,
    TRAIN,
    InstallationFailed,
    call,
    environment,
    pip_install,
    try_out,
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
    source = source_distribution(folder)
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


@pytest.fixture(scope="module")
def serving(wheel_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment for serving, where nothing else is installed."""
    python = environment(tmp_path_factory.mktemp("clean") / "environment")
    try:
        pip_install(python, f"{wheel_file}[serve,ros]")
    except InstallationFailed as error:
        if "from versions: none" in error.said:
            pytest.skip("pip reaches no package index")
        raise
    return python


def test_it_serves_without_torch_and_matplotlib_and_with_its_kernel(
    serving: Path, tmp_path: Path
) -> None:
    """A pose in Python, and a target at its node."""
    script = (ROOT / "tests" / "packaging" / "solve_ur5e.py").read_text(encoding="utf-8")
    kernel = call("solve_ur5e.py", [serving, "-c", LEAN + script], tmp_path)
    assert Path(kernel.strip()).is_relative_to(serving.parents[1])
    try_out(serving, SERVE, tmp_path)


def test_what_is_missing_for_training_is_added_by_the_command_in_the_error(
    serving: Path, tmp_path: Path
) -> None:
    """Then the gantry is trained."""
    with pytest.raises(InstallationFailed) as caught:
        train = ["-m", "annik_training.cli", "train", "--out", MODEL]
        call("annik train", [serving, *train], tmp_path)
    (named,) = re.findall(r"pip install '(annik_ros\[\w+\])'", caught.value.said)
    pip_install(serving, named)
    try_out(serving, TRAIN, tmp_path)
    assert (tmp_path / MODEL).is_file()


def test_without_a_compiler_it_is_built_without_the_kernel_and_says_so(tmp_path: Path) -> None:
    tree = copy_of_the_tree(tmp_path / "source")
    environment = {"CC": "no-such-compiler", "CXX": "no-such-compiler"}
    result = run_python("setup.py", "-q", "build", cwd=tree, environment=environment)
    assert result.returncode == 0, result.stderr
    assert "the kernel could not be compiled" in result.stderr
    built = tree / "build"
    assert list(built.glob("*/annik_core/kernel/__init__.py"))
    assert not list(built.rglob("compiled*.so"))
