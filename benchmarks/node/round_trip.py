"""Round trips, one target at a time, with all nodes alive."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from benchmarks.node.client import Client, no_garbage_collection
from benchmarks.node.nodes import NodeVariant
from benchmarks.node.process_usage import cpu_seconds
from benchmarks.node.results import RoundTripResult, Summary
from benchmarks.node.targets import solvable_targets

#: Pause after a command [s], in which the node finishes what it does after it.
_PAUSE = 3e-4
#: The warm-up is this part of the rounds, and at least so many.
_WARM_UP_PART, _LEAST_WARM_UP = 20, 10


def measure_round_trips(
    client: Client,
    variants: Sequence[NodeVariant],
    rounds: int,
    in_a_row: int,
    logs: Path,
    rng: np.random.Generator,
) -> list[RoundTripResult]:
    """Send targets to all nodes in turn, in a new order every time.

    Args:
        client: sends them.
        variants: the nodes.
        rounds: targets for each.
        in_a_row: targets in a row before those of the next node.
        logs: existing folder for what they print.
        rng: draws targets and orders.

    Raises:
        NoCommand: if no command of a node arrives.
    """
    warm_up = max(_LEAST_WARM_UP, rounds // _WARM_UP_PART)
    models = {variant.model or "gantry" for variant in variants}
    pools = {model: solvable_targets(model, warm_up + rounds, rng) for model in sorted(models)}
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
        stack.enter_context(no_garbage_collection())
        used = [0.0] * len(variants)
        for turn in _turns(warm_up, rounds, in_a_row):
            if turn.start == warm_up:
                used = [cpu_seconds(process.pid) for process in processes]
            for index in rng.permutation(len(variants)).tolist():
                for target in targets[index][turn]:
                    taken = client.round_trip(links[index], target)
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
    """The targets of each turn; none has some of the warm-up and some that count."""
    for begin, end in ((0, warm_up), (warm_up, warm_up + rounds)):
        for start in range(begin, end, in_a_row):
            yield slice(start, min(start + in_a_row, end))


def _pause() -> None:
    """Wait without sleeping: a sleeping processor wakes up slowly."""
    end = time.perf_counter() + _PAUSE
    while time.perf_counter() < end:
        pass
