"""Every use of annik: installed from a wheel into an environment of its own, and tried."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from annik_core.errors import AnnikError
from benchmarks.command_line import (
    ROOT,
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    quick_option,
    write_table,
)
from benchmarks.conditions import machine
from benchmarks.markdown import markdown_table

#: For a model that is trained in these tries.
MODEL = "model.onnx"
SOLVE = (
    "from annik_core import IkSolver\n"
    "answer = IkSolver.from_file('ur5e').solve([0.4, 0.1, 0.5, 0, 1, 0, 0])\n"
    "assert answer.accepted, answer.reason\n"
)
SERVE = (
    "from annik_core.installation import model_path\n"
    "from annik_ros.round_trip import round_trip\n"
    "assert round_trip(model_path('ur5e')), 'no command came back'\n"
)
TRAIN = (
    "import sys\n"
    "from annik_training.cli import cli\n"
    f"cli('train --robot gantry --design thirty_phase --steps 3 --out {MODEL}'.split(),\n"
    "    standalone_mode=False)\n"
    "from annik_core import IkSolver\n"
    f"solver = IkSolver.from_file('{MODEL}')\n"
    "robot = solver.robot\n"
    "pose = robot.forward_kinematics.poses(robot.joint_box.centre[None])[0]\n"
    "assert solver.solve(pose).accepted\n"
)
#: What a robot that serves need not have.
LEAN = (
    "from importlib.util import find_spec\n"
    "found = [name for name in ('torch', 'matplotlib', 'viser', 'dask') if find_spec(name)]\n"
    "assert not found, found\n"
)


@dataclass(frozen=True)
class Use:
    """What annik is installed for.

    Attributes:
        purpose: in words.
        extras: of ``setup.py``.
        script: a Python program that fails if this use doesn't work.
    """

    purpose: str
    extras: tuple[str, ...]
    script: str

    @property
    def requirement(self) -> str:
        """As pip is told."""
        return f"annik_ros[{','.join(self.extras)}]" if self.extras else "annik_ros"


USES = (
    Use("solve in Python; the node, with a sourced ROS 2", (), LEAN + SOLVE),
    Use(
        "all nodes but viewer, with a sourced ROS 2",
        ("serve",),
        LEAN + SOLVE + "import msg_tools.bags.writer\n",
    ),
    Use("all nodes but viewer, with ROS 2 as wheels", ("serve", "ros"), LEAN + SOLVE + SERVE),
    Use("the report of a bag", ("report",), "import msg_tools.report.write\n"),
    Use("the page in the browser", ("view",), "import annik_view.page\n" + SOLVE),
    Use("design, train, calibrate, evaluate", ("train",), TRAIN + SOLVE),
)


class InstallationFailed(AnnikError):
    """An installation, or the try of one, has failed."""

    def __init__(self, what: str, said: str) -> None:
        self.what = what
        self.said = said
        super().__init__(f"{what} failed: {said.strip()[-2000:]}")


def call(what: str, command: Sequence[str | Path], folder: Path) -> str:
    """Run a program in a folder, with nothing of this environment; return what it prints.

    Raises:
        InstallationFailed: if its exit code is not 0.
    """
    kept = ("PATH", "HOME", "LANG", "http_proxy", "https_proxy", "ROS_AUTOMATIC_DISCOVERY_RANGE")
    environment = {
        name: value
        for name, value in os.environ.items()
        if name in (*kept, "ROS_DOMAIN_ID") or name.startswith("PIP_")
    }
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    if result.returncode != 0:
        raise InstallationFailed(what, result.stdout + result.stderr)
    return result.stdout


def environment(folder: Path) -> Path:
    """Make an empty virtual environment; return its interpreter."""
    venv = (sys.executable, "-m", "venv", "--without-pip", folder)
    call("making an environment", venv, folder.parent)
    return folder / "bin" / "python"


def pip_install(python: Path, requirement: str) -> None:
    """Install with the pip of this environment, in the versions of constraints.txt."""
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-compile")
    versions = ("-c", ROOT / "constraints.txt")
    call(f"pip install '{requirement}'", (*pip, *versions, requirement), python.parent)


def try_out(python: Path, script: str, folder: Path) -> None:
    """Run a script of :data:`USES` in an environment; it may leave files in the folder."""
    call("the try", [python, "-c", script], folder)


def megabytes(folder: Path) -> float:
    """The files below a folder [MB]."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(path.stat().st_size for path in files) / 1e6


def _measured(use: Use, wheel: Path, folder: Path) -> tuple[str, ...]:
    python = environment(folder)
    pip_install(python, use.requirement.replace("annik_ros", str(wheel), 1))
    (site,) = (folder / "lib").glob("python*/site-packages")
    size, packages = megabytes(folder), len(list(site.glob("*.dist-info")))
    try_out(python, use.script, folder)
    click.echo(f"{use.requirement}: {size:.0f} MB, works")
    return (
        use.purpose,
        f"`pip install '{use.requirement}'`",
        f"{packages}",
        f"{size:.0f}",
    )


@click.command()
@quick_option("Only the smallest")
@out_option("bench", "the table")
@docs_option("the table, in results/ there,")
def install(quick: bool, out: Path, docs: Path | None) -> None:
    """Install annik for every use, each in an environment of its own; try and measure it."""
    folders = output_folders(out, docs_folder(docs, standard=not quick, quick=quick))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build = (sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, ROOT)
        call("pip wheel", build, folder)
        (wheel,) = folder.glob("*.whl")
        rows = [
            _measured(use, wheel, folder / f"environment_{number}")
            for number, use in enumerate(USES[:1] if quick else USES)
        ]
    header = ("for", "command", "packages", "size [MB]")
    lines = [
        "<!-- Written by ./run bench install -->",
        "",
        markdown_table(header, rows, numbers=2),
        "",
        "Each was installed into an empty environment, with the versions of `constraints.txt`, "
        "and then tried: a pose solved, a target sent to a node and answered, a model trained. "
        "Sizes are with annik, without Python and what it compiles on first use. Torch is the one "
        f"without CUDA. {machine()}",
    ]
    write_table("install", lines, folders)
