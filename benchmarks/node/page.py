"""The page of the benchmark, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

from annik_ros.parameters import ExecutorChoice
from benchmarks.markdown import markdown_table
from benchmarks.node.nodes import NULL, NodeVariant
from benchmarks.node.results import NodeBenchResults, RoundTripResult
from benchmarks.node.settings import QUICK, NodeBenchSettings

_NULL_NAME = NodeVariant(NULL).name


def command(settings: NodeBenchSettings) -> str:
    """What to type for the same."""
    base = QUICK if settings == QUICK else NodeBenchSettings()
    standard = asdict(base)
    options = [
        f"--{name.replace('_', '-')} {value:g}"
        for name, value in asdict(settings).items()
        if value != standard[name] and isinstance(value, (int, float))
    ]
    return " ".join(["./run bench node", *(["--quick"] if base is QUICK else []), *options])


def node_bench_page(results: NodeBenchResults) -> str:
    """The page."""
    settings = results.settings
    parts = [
        f"<!-- Written by {command(settings)} -->",
        str(results.conditions),
        "#### Round trip",
        *(part for in_a_row in settings.in_a_row for part in _round_trip_parts(results, in_a_row)),
        f"#### Streams\n\n{_streams(results)}",
        f"{settings.stream_seconds:g} s each; ik_node is the gantry's, and both nodes have the "
        "events executor. Age: of the targets with a command, when it was stamped.",
        f"#### Memory\n\n{_memory(results)}",
        f"Resident set at 1 kHz, after {settings.warm_up_seconds:g} s of it, both nodes at once; "
        "1 MB is 1e6 bytes.",
        f"#### Start\n\n{_starts(results)}",
        "From the start of the process to the first command, with the events executor. Of that, "
        "the middleware's discovery takes between nothing and some seconds, for any node.",
    ]
    if results.skipped:
        parts.append("Skipped: " + "; ".join(results.skipped) + ".")
    return "\n\n".join(parts) + "\n"


def _round_trip_parts(results: NodeBenchResults, in_a_row: int) -> tuple[str, str]:
    busy = (
        f"{in_a_row} in a row before those of the next node: each is as busy as a controller "
        "keeps it"
        if in_a_row > 1
        else "targets of the other nodes between any two: each node finds the processor's caches "
        "as the others left them"
    )
    chosen = [result for result in results.round_trips if result.in_a_row == in_a_row]
    return (
        f"{results.settings.rounds} targets for each node, one at a time, {busy}. From the "
        "client's publisher to the client's callback; processor time is the node's own.",
        _round_trips(chosen),
    )


def _round_trips(results: Sequence[RoundTripResult]) -> str:
    null = {result.executor: result for result in results if result.node == _NULL_NAME}
    single = null[ExecutorChoice.SINGLE_THREADED.value]
    rows = [
        (
            result.node,
            result.executor,
            f"{result.time.p50:.0f}",
            f"{result.time.p99:.0f}",
            f"{result.time.p50 / null[result.executor].time.p50:.2f}",
            f"{result.time.p99 / null[result.executor].time.p99:.2f}",
            f"{result.time.p50 / single.time.p50:.2f}",
            f"{result.cpu:.0f}",
            f"{result.unanswered}",
        )
        for result in results
    ]
    header = (
        "node",
        "executor",
        "p50 [us]",
        "p99 [us]",
        "p50 / null node's, same executor",
        "p99 / null node's, same executor",
        "p50 / null node's, single_threaded",
        "CPU per message [us]",
        "without a command",
    )
    return markdown_table(header, rows, len(header) - 2)


def _streams(results: NodeBenchResults) -> str:
    rows = [
        (
            result.node,
            f"{result.rate:.0f}",
            f"{result.queue_depth}",
            f"{result.reached_rate:.0f}",
            f"{result.sent}",
            f"{result.answered}",
            f"{100.0 * result.answered / result.sent:.3f}",
            f"{result.age.p50:.2f}",
            f"{result.age.p99:.2f}",
            f"{result.age.max:.1f}",
            f"{result.cpu:.0f}",
        )
        for result in results.streams
    ]
    header = (
        "node",
        "rate [1/s]",
        "queue_depth",
        "rate reached [1/s]",
        "sent",
        "with a command",
        "with a command [%]",
        "age p50 [ms]",
        "age p99 [ms]",
        "age max [ms]",
        "CPU [% of a core]",
    )
    return markdown_table(header, rows, len(header) - 1)


def _memory(results: NodeBenchResults) -> str:
    rows = [
        (
            result.node,
            f"{result.minutes:g}",
            f"{result.answers}",
            f"{result.begin:.2f}",
            f"{result.end:.2f}",
            f"{result.largest:.2f}",
            f"{result.end - result.begin:.2f}",
        )
        for result in results.memory
    ]
    header = (
        "node",
        "time [min]",
        "commands",
        "begin [MB]",
        "end [MB]",
        "largest [MB]",
        "growth [MB]",
    )
    return markdown_table(header, rows, len(header) - 1)


def _starts(results: NodeBenchResults) -> str:
    rows = [
        (
            result.node,
            f"{result.starts}",
            f"{result.fastest:.2f}",
            f"{result.median:.2f}",
            f"{result.worst:.2f}",
        )
        for result in results.starts
    ]
    return markdown_table(("node", "starts", "fastest [s]", "median [s]", "worst [s]"), rows, 4)
