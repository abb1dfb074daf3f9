"""Run the notebook of the documentation, and write it with what it shows: part of ./run docs."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parent / "few_examples.ipynb"
#: Longest time of one cell [s]; a loaded machine is slow.
PATIENCE = 1800


def executed() -> nbformat.NotebookNode:
    """The notebook, run from top to bottom in an empty folder."""
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    for cell in notebook.cells:
        cell.metadata.clear()
    with TemporaryDirectory() as folder:
        client = NotebookClient(
            notebook,
            timeout=PATIENCE,
            record_timing=False,
            resources={"metadata": {"path": folder}},
        )
        client.execute()
    return notebook


if __name__ == "__main__":
    nbformat.write(executed(), NOTEBOOK)
