"""A copy of this checkout, as a user who has just cloned it has one."""

from __future__ import annotations

import shutil
from pathlib import Path

from support.processes import LONG_PATIENCE, ROOT, run_python

IMPORT_PACKAGES = ("annik_core", "annik_view", "annik_training", "annik_ros", "msg_tools")
SHARED_FOLDERS = ("config", "launch", "models", "robots")
#: Environment in which the kernel is compiled in a quarter of the time.
QUICK_BUILD = {"CXXFLAGS": "-O0"}


def copy_of_the_tree(destination: Path) -> Path:
    """Copy the checkout without what git ignores, over an older copy; returns the destination."""
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()
    patterns = [line.rstrip("/") for line in ignored if line and not line.startswith("#")]
    ignore = shutil.ignore_patterns(".git", *patterns)
    shutil.copytree(ROOT, destination, ignore=ignore, dirs_exist_ok=True)
    return destination


def source_distribution(folder: Path) -> Path:
    """Make the source distribution of this checkout in a folder."""
    tree = copy_of_the_tree(folder / "source")
    made = run_python("setup.py", "-q", "sdist", "-d", folder, cwd=tree, patience=LONG_PATIENCE)
    assert made.returncode == 0, made.stderr
    (path,) = folder.glob("*.tar.gz")
    return path
