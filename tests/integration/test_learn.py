"""``./run learn``: measure, learn and drive a robot that is not as described."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.processes import LONG_PATIENCE, run_python

from annik_core.dataset import load_dataset


@pytest.mark.slow
def test_learn(tmp_path: Path) -> None:
    """Twenty poses take it from millimetres to a few hundredths."""
    folder = tmp_path / "learn"
    command = ("-m", "examples.learn", "--examples", 20, "--out", folder)
    result = run_python(*command, patience=LONG_PATIENCE)
    assert result.returncode == 0, result.stdout + result.stderr
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    for name in ("nominal", "learned"):
        assert results[name]["targets_sent"] == results[name]["targets_answered"] == 201
    assert results["nominal"]["position_error_mm"]["p50"] > 2.0
    # The noise of the poses, and so which parts are chosen, differs from run to run.
    assert results["learned"]["position_error_mm"]["p50"] < 0.05
    assert results["learned"]["position_error_mm"]["max"] < 0.2
    assert results["learned"]["orientation_error_deg"]["max"] < 0.01
    assert results["fit"]["examples"] == 20

    measured = load_dataset(folder / "measured.npz")
    planned = load_dataset(folder / "plan.npz")
    np.testing.assert_array_equal(measured.joint_positions, planned.joint_positions)
    assert measured.measurement_noise is not None
    for name in ("before_and_after.png", "learned.onnx", "nominal/report.html"):
        assert (folder / name).stat().st_size > 0
