"""Refused targets, by the diagnostics of an ik_node."""

from collections import defaultdict
from collections.abc import Iterable
from typing import Any, Final, NamedTuple

_REFUSED: Final = "targets refused"
_REASON_PREFIX: Final = "refused: "


class RefusalCounts(NamedTuple):
    """Refused targets of one ik_node since its start; by reason, most frequent first.

    ``last`` is the last refusal in words, with the value and what is allowed.
    """

    stamp_ns: int  #: header stamp of the diagnostics [ns]
    refused: int
    reasons: dict[str, int]
    last: str


def refusal_history(diagnostics: Iterable[Any], namespace: str) -> tuple[RefusalCounts, ...]:
    """The counts that the ik_node of a namespace published, without repetitions.

    The ``DiagnosticArray`` messages are in order of time; ``/`` is the root namespace. Empty
    without counts, or if several nodes match.
    """
    found: dict[str, list[RefusalCounts]] = defaultdict(list)
    for array in diagnostics:
        stamp = array.header.stamp
        for status in array.status:
            values = {entry.key: entry.value for entry in status.values}
            counts = _counts(stamp.sec * 1_000_000_000 + stamp.nanosec, values)
            if counts is None:
                continue
            history = found[status.name]
            if not history or counts[1:] != history[-1][1:]:
                history.append(counts)
    if len(found) > 1 and namespace != "/":
        name = namespace.strip("/")
        found = {k: counts for k, counts in found.items() if name in k.strip("/").split("/")}
    return tuple(next(iter(found.values()))) if len(found) == 1 else ()


def _counts(stamp_ns: int, values: dict[str, str]) -> RefusalCounts | None:
    try:
        refused = int(values[_REFUSED])
        reasons = {
            key.removeprefix(_REASON_PREFIX): int(value)
            for key, value in values.items()
            if key.startswith(_REASON_PREFIX)
        }
    except (KeyError, ValueError):
        return None
    ordered = sorted(reasons.items(), key=lambda reason: -reason[1])
    counts = {reason: count for reason, count in ordered if count > 0}
    return RefusalCounts(stamp_ns, refused, counts, values.get("last refusal", ""))
