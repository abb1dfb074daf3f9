"""The notebook of the documentation runs from top to bottom, and shows what it says. ROS-free."""

from __future__ import annotations

import re
from typing import Any

import pytest

pytest.importorskip("nbclient", reason="the notebook needs nbclient: pip install '.[docs]'")
pytest.importorskip("ipykernel", reason="the notebook needs ipykernel: pip install '.[docs]'")

import nbformat

from docs.notebook import NOTEBOOK, executed


def outputs(notebook: Any) -> tuple[str, int]:
    """What its cells print, and the number of their figures."""
    shown = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    text = "".join(output.text for output in shown if output.output_type == "stream")
    return text, sum("image/png" in output.get("data", {}) for output in shown)


@pytest.mark.process
@pytest.mark.slow
def test_it_runs_from_top_to_bottom_and_has_its_figures() -> None:
    printed, figures = outputs(executed())
    assert figures == 2
    missed = dict(re.findall(r"(\S+): missed by ([\d.]+) mm", printed))
    assert float(missed["ur5e"]) > 1.0
    assert float(missed["calibrated.onnx"]) < 0.2


def test_what_it_shows_is_in_the_repository() -> None:
    """For GitHub and the site."""
    printed, figures = outputs(nbformat.read(NOTEBOOK, as_version=4))
    assert figures == 2
    assert "calibrated.onnx: missed by" in printed
