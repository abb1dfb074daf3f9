"""``./run bench node``: options, and the files that it leaves."""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from types import FrameType
from typing import NoReturn

import click

from annik_core.files import ensure_writable_folder, write_files_atomically
from annik_ros.processes import end_all
from benchmarks.command_line import (
    DOCS,
    chosen,
    docs_folder,
    docs_option,
    out_option,
    page_only_option,
    quick_option,
)
from benchmarks.node.page import node_bench_page
from benchmarks.node.results import NodeBenchResults
from benchmarks.node.run import run_node_bench
from benchmarks.node.settings import QUICK, NodeBenchSettings

PAGE = "node_bench.md"
DATA = "node_bench.json"
#: Where both go in the documentation.
_DOCS_FOLDER = "results"


_STANDARD = NodeBenchSettings()
_POSITIVE = click.FloatRange(0.0, min_open=True)


@click.command()
@click.option(
    "--rounds",
    type=click.IntRange(1),
    help=f"Round trips of each node (default {_STANDARD.rounds}).",
)
@click.option(
    "--stream-seconds",
    type=_POSITIVE,
    help=f"How long each stream lasts [s] (default {_STANDARD.stream_seconds:g}).",
)
@click.option(
    "--memory-minutes",
    type=_POSITIVE,
    help=f"How long the memory is watched [min] (default {_STANDARD.memory_minutes:g}).",
)
@click.option(
    "--starts", type=click.IntRange(1), help=f"Starts of each node (default {_STANDARD.starts})."
)
@quick_option("Everything, roughly")
@page_only_option()
@out_option("bench", "page, data and logs")
@docs_option("page and data, in results/ there,")
def node(
    quick: bool, page_only: bool, out: Path, docs: Path | None, **amounts: float | None
) -> None:
    """The node: ik_node beside one that does nothing, over ROS 2.

    Round trips, streams of targets, processor time, memory and start. Takes about half an hour.
    """
    if page_only:
        folder = (docs or DOCS) / _DOCS_FOLDER
        results = NodeBenchResults.from_dict(json.loads((folder / DATA).read_text("utf-8")))
        write_files_atomically(folder, {PAGE: node_bench_page(results).encode()})
        return
    settings = chosen(QUICK if quick else _STANDARD, amounts)
    docs = docs_folder(docs, standard=settings == _STANDARD, quick=quick)
    _isolate()
    # A shell that starts it in the background has SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _on_termination)
    try:
        _bench(settings, out, docs)
    except KeyboardInterrupt:
        click.get_current_context().exit(128 + signal.SIGINT)
    finally:
        end_all()


def _isolate() -> None:
    """Keep targets and commands to this machine and domain, and messages unchecked."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
    os.environ.pop("ROS_PYTHON_CHECK_FIELDS", None)


def _bench(settings: NodeBenchSettings, out: Path, docs: Path | None) -> None:
    folders = [out, *([docs / _DOCS_FOLDER] if docs is not None else [])]
    logs = out / "node_bench_logs"
    for folder in (*folders, logs):
        # Before the minutes of measuring, not after them.
        ensure_writable_folder(folder)
    results = run_node_bench(
        settings, logs, lambda part: print(f"measuring {part}", file=sys.stderr, flush=True)
    )
    print(node_bench_page(results))
    for folder in folders:
        _write(results, folder)
        print(f"wrote {PAGE} and {DATA} to {folder}")


def _write(results: NodeBenchResults, folder: Path) -> None:
    data = json.dumps(results.to_dict(), indent=2) + "\n"
    contents = {PAGE: node_bench_page(results).encode(), DATA: data.encode()}
    write_files_atomically(folder, contents)


def _on_termination(signal_number: int, frame: FrameType | None) -> NoReturn:
    # An exception, so that the started processes are ended on the way out.
    raise SystemExit(128 + signal_number)
