"""``annik bench node``: what it is asked for, and the files that it leaves."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from dataclasses import asdict, replace
from pathlib import Path
from types import FrameType
from typing import NoReturn

from annik_core.errors import AnnikError
from annik_core.files import ensure_writable_folder, write_files_atomically
from annik_ros.processes import end_all
from benchmarks.node.page import node_bench_page
from benchmarks.node.results import NodeBenchResults
from benchmarks.node.run import run_node_bench
from benchmarks.node.settings import QUICK, NodeBenchSettings

PAGE = "node_bench.md"
DATA = "node_bench.json"
#: Where both go in the documentation.
_DOCS_FOLDER = "results"


def main() -> int:
    """Measure, and write page and data; returns the exit code."""
    arguments = _parser().parse_args()
    settings = _settings(arguments)
    _isolate()
    # A shell that starts it in the background has SIGINT ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, _on_termination)
    try:
        _bench(settings, arguments.out, arguments.docs)
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except AnnikError as error:
        print(f"annik: {error}", file=sys.stderr)
        return 1
    finally:
        end_all()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="annik bench node",
        description="How quick ik_node is, beside a node that does nothing.",
    )
    standard = NodeBenchSettings()
    parser.add_argument(
        "--rounds", type=_positive_int, help=f"round trips of each node ({standard.rounds})"
    )
    parser.add_argument(
        "--stream-seconds",
        type=_positive,
        help=f"how long each stream lasts [s] ({standard.stream_seconds:g})",
    )
    parser.add_argument(
        "--memory-minutes",
        type=_positive,
        help=f"how long the memory is watched [min] ({standard.memory_minutes:g})",
    )
    parser.add_argument(
        "--starts", type=_positive_int, help=f"starts of each node ({standard.starts})"
    )
    parser.add_argument(
        "--quick", action="store_true", help="everything, roughly, in half a minute"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("build/bench"), help="folder for page, data and logs"
    )
    parser.add_argument(
        "--docs", type=Path, help="also write page and data to results/ in this folder"
    )
    return parser


def _settings(arguments: argparse.Namespace) -> NodeBenchSettings:
    base = QUICK if arguments.quick else NodeBenchSettings()
    names = (name for name in asdict(base) if name in arguments)
    given = {name: getattr(arguments, name) for name in names}
    return replace(base, **{name: value for name, value in given.items() if value is not None})


def _isolate() -> None:
    """Let nobody else hear the targets and commands, and nothing slow the messages down."""
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
    data = json.dumps(results.as_plain_data(), indent=2) + "\n"
    contents = {PAGE: node_bench_page(results).encode(), DATA: data.encode()}
    write_files_atomically(folder, contents)


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not greater than 0")
    return value


def _positive_int(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not at least 1")
    return value


def _on_termination(signal_number: int, frame: FrameType | None) -> NoReturn:
    # An exception, so that the processes started are ended on the way out.
    raise SystemExit(128 + signal_number)
