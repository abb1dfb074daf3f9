"""``./run``, from another folder: help starts nothing, quick runs leave the checkout as it was."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click import Command, Context
from click.testing import CliRunner
from support.processes import LONG_PATIENCE, PATIENCE

from benchmarks.__main__ import BENCHMARKS, bench
from benchmarks.command_line import ROOT
from benchmarks.paper.command import paper
from benchmarks.study.command import study

#: ./run uses what it made itself: elsewhere it would set up for minutes.
pytestmark = [
    pytest.mark.process,
    pytest.mark.skipif(
        not (ROOT / ".venv" / "annik-setup").is_file(), reason="the checkout is not set up"
    ),
]
COMMANDS = ("demo", "learn", "test", "train", "paper", "study", "report", "annik", "ros", "bench")
COMMANDS += ("docs", "site", "soak", "sanitize", "lint", "format", "setup")


def run(
    folder: Path, *arguments: str, seconds: float = LONG_PATIENCE
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [ROOT / "run", *arguments],
        cwd=folder,
        env={**os.environ, "PYTHON_COLORS": "0", "TERM": "dumb"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=seconds,
    )


def changed_files() -> str:
    """Tracked files that differ from the last commit, and how."""
    return subprocess.run(
        ["git", "diff", "HEAD"], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE
    ).stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_every_command(tmp_path: Path, command: str) -> None:
    result = run(tmp_path, command, "--help")
    assert result.returncode == 0, result.stderr
    assert "usage" in result.stdout.lower()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", BENCHMARKS)
def test_help_of_every_benchmark(name: str) -> None:
    result = CliRunner().invoke(bench, [name, "--help"])
    assert result.exit_code == 0, result.output
    assert "--quick" in result.output
    assert name in CliRunner().invoke(bench, ["--help"]).output


@pytest.mark.parametrize(
    "arguments",
    [("no_such",), ("bench", "no_such"), ("ros", "no_such"), ("lint", "no_such")],
)
def test_an_unknown_name_is_one_line(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    result = run(tmp_path, *arguments)
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert "no_such" in line


def test_the_usage_names_every_command(tmp_path: Path) -> None:
    usage = run(tmp_path, "help").stdout
    for command in COMMANDS:
        assert f"\n  {command} " in usage


@pytest.mark.parametrize(
    ("arguments", "files"),
    [
        (
            ("study", "--quick", "--systems", "elbow_arm", "--seeds", "1", "--examples", "16"),
            ("study.md", "summary.csv"),
        ),
        (("bench", "solve_time", "--quick", "--rounds", "10"), ("solve_time.md",)),
        (("bench", "fit_methods", "--quick", "--evaluations", "1"), ("fit_methods.md",)),
    ],
)
@pytest.mark.slow
def test_a_quick_run_writes_to_its_folder_alone(
    tmp_path: Path, arguments: tuple[str, ...], files: tuple[str, ...]
) -> None:
    """The folder is relative to that of the caller."""
    before = changed_files()
    result = run(tmp_path, *arguments, "--out", "found/here")
    assert result.returncode == 0, result.stderr
    for file in files:
        assert (tmp_path / "found" / "here" / file).is_file()
    assert [path.name for path in tmp_path.iterdir()] == ["found"]
    assert changed_files() == before


@pytest.mark.parametrize("name", ["paper", "study", *BENCHMARKS])
def test_a_quick_run_is_kept_out_of_the_documentation(tmp_path: Path, name: str) -> None:
    command: Command = {"paper": paper, "study": study}.get(name) or bench.get_command(
        Context(bench), name
    )
    result = CliRunner().invoke(command, ["--quick", "--docs", str(tmp_path)])
    assert result.exit_code == 2
    assert "--docs" in result.output
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["paper", "study"])
def test_the_environment_is_set_before_numpy_is_loaded(name: str) -> None:
    """Libraries read it when they are loaded: see benchmarks/same_rounding.py."""
    script = (
        f"import sys, benchmarks.{name}.__main__\n"
        "sys.exit(bool({'numpy', 'torch'} & set(sys.modules)))"
    )
    subprocess.run([sys.executable, "-c", script], cwd=ROOT, check=True, timeout=PATIENCE)
