"""Refused targets, by the diagnostics of an ik_node."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, Final

_REFUSED: Final = "targets refused"
_REASON_PREFIX: Final = "refused: "


@dataclass(frozen=True)
class RefusalCounts:
    """Refused targets of one ik_node since its start; by reason, most frequent first.

    ``last`` is the last refusal in words, with the value and what is allowed.
    """

    refused: int
    reasons: dict[str, int] = field(default_factory=dict)
    last: str = ""


def refusal_counts(diagnostics: Iterable[Any], namespace: str) -> RefusalCounts | None:
    """The last counts that the ik_node of a namespace published; ``/`` is the root.

    The ``DiagnosticArray`` messages are in order of time. None without counts, or if several nodes
    match.
    """
    last: dict[str, RefusalCounts] = {}
    for array in diagnostics:
        for status in array.status:
            counts = _counts({entry.key: entry.value for entry in status.values})
            if counts is not None:
                last[status.name] = counts
    if len(last) > 1 and namespace != "/":
        name = namespace.strip("/")
        last = {key: counts for key, counts in last.items() if name in key.strip("/").split("/")}
    return next(iter(last.values())) if len(last) == 1 else None


def _counts(values: dict[str, str]) -> RefusalCounts | None:
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
    return RefusalCounts(refused, counts, values.get("last refusal", ""))
