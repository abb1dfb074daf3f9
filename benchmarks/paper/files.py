"""The files of the reproduction: results, tables, figures and the page."""

from __future__ import annotations

import json
from pathlib import Path

from annik_core.files import ensure_writable_folder, write_files_atomically
from benchmarks.conditions import machine
from benchmarks.paper.csv_tables import csv_tables
from benchmarks.paper.document import paper_document
from benchmarks.paper.figures import paper_figures
from benchmarks.paper.reproduction import Measurements
from benchmarks.paper.results import results

RESULTS = "results.json"
PAGE = "paper.md"
#: Where the figures are in the documentation, and how their names begin there.
_DOCS_IMAGES = "images"
_DOCS_PREFIX = "paper_"


def check_writable(*folders: Path) -> None:
    """Find out before the fits, not after them.

    Raises:
        NotWritable: naming the folder.
    """
    for folder in folders:
        ensure_writable_folder(folder)


def write_reproduction(measured: Measurements, folder: Path, docs: Path | None) -> None:
    """Write results.json, tables (.csv), figures (.png) and the page (paper.md).

    Args:
        measured: what was measured.
        folder: where to.
        docs: where the page goes too, its figures into ``images`` there.

    Raises:
        NotWritable: if a file can't be written.
    """
    found = results(measured)
    ran_on = machine()
    figures = paper_figures(measured)
    page = paper_document(found, "", ran_on).encode()
    content = {
        RESULTS: (json.dumps(found, indent=2, allow_nan=False) + "\n").encode(),
        PAGE: page,
        **csv_tables(measured),
        **figures,
    }
    _write(folder, content)
    if docs is not None:
        images = {f"{_DOCS_PREFIX}{name}": figure for name, figure in figures.items()}
        _write(docs / _DOCS_IMAGES, images)
        page = paper_document(found, f"{_DOCS_IMAGES}/{_DOCS_PREFIX}", ran_on).encode()
        _write(docs, {PAGE: page})


def _write(folder: Path, content: dict[str, bytes]) -> None:
    ensure_writable_folder(folder)
    write_files_atomically(folder, content)
