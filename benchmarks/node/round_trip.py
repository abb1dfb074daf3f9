"""Round trips: every node alive, each asked in its turn, one target at a time."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.node.client import Client, undisturbed
from benchmarks.node.nodes import NodeVariant
from benchmarks.node.process_usage import cpu_seconds
from benchmarks.node.results import RoundTripResult, Summary
from benchmarks.node.targets import answered_targets

#: A node that has answered publishes and notes some more things; meanwhile nobody is asked [s].
_PAUSE = 3e-4
#: Rounds that do not count, of those that do: one in so many, and at least so many.
_WARM_UP_PART, _LEAST_WARM_UP = 20, 10


def measure_round_trips(
    client: Client,
    variants: Sequence[NodeVariant],
    rounds: int,
    in_a_row: int,
    logs: Path,
    rng: np.random.Generator,
) -> list[RoundTripResult]:
    """Ask all nodes in turn, in a new order every time.

    Args:
        client: asks.
        variants: the nodes.
        rounds: how often each is asked.
        in_a_row: how often before it is the next one's turn.
        logs: existing folder for what they print.
        rng: draws targets and orders.

    Raises:
        NoAnswer: if a node never answers.
    """
    warm_up = max(_LEAST_WARM_UP, rounds // _WARM_UP_PART)
    models = {variant.model or "gantry" for variant in variants}
    pools = {model: answered_targets(model, warm_up + rounds, rng) for model in sorted(models)}
    targets = [pools[variant.model or "gantry"] for variant in variants]
    times: list[list[float]] = [[] for _ in variants]
    unanswered = [0] * len(variants)
    with ExitStack() as stack:
        namespaces = [f"/round_trip_{index}" for index in range(len(variants))]
        links = [client.link(namespace) for namespace in namespaces]
        for link in links:
            stack.callback(link.destroy)
        processes = [
            stack.enter_context(variant.start(namespace, logs))
            for variant, namespace in zip(variants, namespaces, strict=True)
        ]
        for link, pool in zip(links, targets, strict=True):
            client.connect(link, pool[0])
        stack.enter_context(undisturbed())
        used = [0.0] * len(variants)
        for turn in _turns(warm_up, rounds, in_a_row):
            if turn.start == warm_up:
                used = [cpu_seconds(process.pid) for process in processes]
            for index in rng.permutation(len(variants)).tolist():
                for target in targets[index][turn]:
                    taken = client.ask(links[index], target)
                    if taken is None:
                        unanswered[index] += turn.start >= warm_up
                        client.quiet(links[index])
                    elif turn.start >= warm_up:
                        times[index].append(1e6 * taken)
                    _pause()
        used = [
            cpu_seconds(process.pid) - before
            for process, before in zip(processes, used, strict=True)
        ]
    return [
        RoundTripResult(
            variant.name,
            variant.executor,
            in_a_row,
            Summary.of(times[index]),
            1e6 * used[index] / rounds,
            rounds,
            unanswered[index],
        )
        for index, variant in enumerate(variants)
    ]


def _turns(warm_up: int, rounds: int, in_a_row: int) -> Iterator[slice]:
    """Which targets are sent in each turn; none has some that count and some that do not."""
    for begin, end in ((0, warm_up), (warm_up, warm_up + rounds)):
        for start in range(begin, end, in_a_row):
            yield slice(start, min(start + in_a_row, end))


def _pause() -> None:
    """Wait without sleeping, from which a processor would have to be woken up."""
    end = time.perf_counter() + _PAUSE
    while time.perf_counter() < end:
        pass
