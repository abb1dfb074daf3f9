"""Which sent target an accepted one was.

``target_pose`` carries no stamp, so a target is recognised by its pose. The position is copied bit
for bit from the sent to the accepted target; the quaternion may have been normalised on the way.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from annik_core.pose import FloatArray

_QUATERNION_TOLERANCE: Final = 1e-9


class TimedPose(NamedTuple):
    """A pose in a message.

    Attributes:
        topic: absolute name of the topic.
        time_ns: when it was sent, or received if that is not known [ns since the epoch].
        pose: ``(7,)``; x, y, z [m], quaternion x, y, z, w.
    """

    topic: str
    time_ns: int
    pose: FloatArray


def match_targets(sent: Sequence[TimedPose], accepted: Sequence[TimedPose]) -> list[int | None]:
    """The sent target of each accepted one.

    In order of time, each accepted target takes the first sent one that has its pose, was sent
    before, has not been taken, and on its topic comes after those taken before: a node answers a
    topic in order, so what was passed over was refused or dropped. Only if there is none, one that
    was passed over is taken (messages of two publishers may arrive in another order than sent).

    Args:
        sent: targets of one or several topics, in any order.
        accepted: in any order.

    Returns:
        For each of ``accepted`` an index into ``sent``, or None.
    """
    by_position: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for index in sorted(range(len(sent)), key=lambda i: sent[i].time_ns):
        by_position[_position(sent[index].pose)].append(index)
    last_taken: dict[str, int] = defaultdict(lambda: -1)
    matches: list[int | None] = [None] * len(accepted)
    for number in sorted(range(len(accepted)), key=lambda i: accepted[i].time_ns):
        answer = accepted[number]
        free = by_position.get(_position(answer.pose), [])
        in_order = (i for i in free if sent[i].time_ns > last_taken[sent[i].topic])
        match = _first_fitting(sent, in_order, answer)
        if match is None:
            match = _first_fitting(sent, free, answer)
        if match is None:
            continue
        last_taken[sent[match].topic] = max(last_taken[sent[match].topic], sent[match].time_ns)
        free.remove(match)
        matches[number] = match
    return matches


def _first_fitting(
    sent: Sequence[TimedPose], candidates: Iterable[int], answer: TimedPose
) -> int | None:
    for index in candidates:
        if sent[index].time_ns > answer.time_ns:
            return None
        if _same_orientation(sent[index].pose, answer.pose):
            return index
    return None


def _position(pose: FloatArray) -> tuple[float, ...]:
    return tuple(pose[:3].tolist())


def _same_orientation(first: FloatArray, second: FloatArray) -> bool:
    """Whether two quaternions, of any norm but zero, are the same rotation."""
    # Sent targets may hold anything; what is not finite fits nothing.
    with np.errstate(all="ignore"):
        norms = float(np.linalg.norm(first[3:]) * np.linalg.norm(second[3:]))
        product = abs(float(first[3:] @ second[3:]))
    return norms > 0 and 1.0 - product / norms <= _QUATERNION_TOLERANCE
