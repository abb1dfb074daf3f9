"""The long test in short, and that it tells a finding from none."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
import soak
from support.processes import LONG_PATIENCE, run_python


@pytest.mark.slow
def test_a_short_soak_finds_nothing() -> None:
    """As a command: a line for each fault, a summary, exit code 0."""
    script = Path(soak.__file__)
    paths = [str(script.parents[2]), *sys.path]
    finished = run_python(
        *(script, "--minutes", 0.15, "--seed", 7),
        environment={"PYTHONPATH": os.pathsep.join(paths)},
        patience=LONG_PATIENCE,
    )
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert finished.stdout.startswith("seed 7, 0.15 minutes, logs in ")
    assert "nothing found (seed 7)" in finished.stdout
    assert ": survived" in finished.stdout


def test_a_finding_is_named_with_its_seed_and_its_logs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 1; and everything that was started is ended."""
    closed = []

    class Failing:
        sent = 0

        def __init__(self, *_: object) -> None:
            self.faults = {"the fault": lambda: pytest.fail("what was wrong")}

        def check(self) -> None:
            pass

        def order(self) -> list[str]:
            return list(self.faults)

        def close(self) -> None:
            closed.append(self)

    monkeypatch.setattr(soak, "Soak", Failing)
    assert soak.main(["--minutes", "1", "--seed", "3"]) == 1
    printed = capsys.readouterr().out
    assert "FOUND by 'the fault'" in printed
    assert "what was wrong" in printed
    assert "./run soak --seed 3" in printed
    assert len(closed) == 1
