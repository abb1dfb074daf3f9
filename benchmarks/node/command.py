"""``./run bench node``: options, and the files that it leaves."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import click

from annik_core.files import ensure_writable_folder
from benchmarks.command_line import (
    chosen,
    docs_folder,
    docs_option,
    out_option,
    output_folders,
    page_only_option,
    quick_option,
    rewrite_page,
    write_results,
)
from benchmarks.node.page import node_bench_page
from benchmarks.node.results import NodeBenchResults
from benchmarks.node.run import run_node_bench
from benchmarks.node.settings import QUICK, NodeBenchSettings
from examples.demonstration import ended_by_signals, reserved_domain

PAGE = "node_bench.md"
DATA = "node_bench.json"
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
        rewrite_page(
            docs, PAGE, DATA, lambda data: node_bench_page(NodeBenchResults.from_dict(data))
        )
        return
    settings = chosen(QUICK if quick else _STANDARD, amounts)
    docs = docs_folder(docs, standard=settings == _STANDARD, quick=quick)
    with reserved_domain() as domain, ended_by_signals():
        _isolate(domain)
        _bench(settings, out, docs)


def _isolate(domain: int) -> None:
    """Keep targets and commands to this machine and domain, and messages unchecked."""
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    os.environ.pop("ROS_PYTHON_CHECK_FIELDS", None)


def _bench(settings: NodeBenchSettings, out: Path, docs: Path | None) -> None:
    folders = output_folders(out, docs)
    logs = out / "node_bench_logs"
    ensure_writable_folder(logs)
    results = run_node_bench(
        settings, logs, lambda part: print(f"measuring {part}", file=sys.stderr, flush=True)
    )
    print(node_bench_page(results))
    data = json.dumps(results.to_dict(), indent=2) + "\n"
    write_results(folders, {PAGE: node_bench_page(results), DATA: data})
