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


class TargetMatches(NamedTuple):
    """Which sent target each accepted one was.

    Attributes:
        sent: for each accepted target the index of the sent one, or None if it is not known.
        ambiguous: indices of the accepted targets that several sent ones may have been.
    """

    sent: list[int | None]
    ambiguous: frozenset[int]


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


def match_targets(sent: Sequence[TimedPose], accepted: Sequence[TimedPose]) -> TargetMatches:
    """The sent target of each accepted one.

    In order of time, each accepted target takes the first sent one that has its pose, was sent
    before, has not been taken, and on its topic comes after those taken before: a node answers a
    topic in order, so what was passed over was refused or dropped. Only if there is none, one that
    was passed over is taken (messages of two publishers may arrive in another order than sent).

    Where several sent targets fit an accepted one, and more of that pose were sent than accepted,
    any of them may be the one that was dropped: the match is then not known.

    Args:
        sent: targets of one or several topics, in any order.
        accepted: in any order.
    """
    by_position: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for index in sorted(range(len(sent)), key=lambda i: sent[i].time_ns):
        by_position[_position(sent[index].pose)].append(index)
    census = _Census(sent, accepted)
    last_taken: dict[str, int] = defaultdict(lambda: -1)
    matches: list[int | None] = [None] * len(accepted)
    ambiguous: set[int] = set()
    for number in sorted(range(len(accepted)), key=lambda i: accepted[i].time_ns):
        answer = accepted[number]
        free = by_position.get(_position(answer.pose), [])
        in_order = (i for i in free if sent[i].time_ns > last_taken[sent[i].topic])
        fitting = _first_two_fitting(sent, in_order, answer)
        if not fitting:
            fitting = _first_two_fitting(sent, free, answer)
        if not fitting:
            continue
        # Taken also if ambiguous: the true one is not earlier, so those after it stay possible.
        match = fitting[0]
        last_taken[sent[match].topic] = max(last_taken[sent[match].topic], sent[match].time_ns)
        free.remove(match)
        if len(fitting) > 1 and census.more_sent_than_accepted(answer.pose):
            ambiguous.add(number)
        else:
            matches[number] = match
    return TargetMatches(matches, frozenset(ambiguous))


class _Census:
    """How many targets of one pose were sent and accepted; counted when asked, each pose once."""

    def __init__(self, sent: Sequence[TimedPose], accepted: Sequence[TimedPose]) -> None:
        self._sent = _poses_by_position(sent)
        self._accepted = _poses_by_position(accepted)
        self._known: dict[tuple[float, ...], list[tuple[FloatArray, bool]]] = defaultdict(list)

    def more_sent_than_accepted(self, pose: FloatArray) -> bool:
        position = _position(pose)
        for known, answer in self._known[position]:
            if _same_orientation(known, pose):
                return answer
        answer = self._count(self._sent, pose) > self._count(self._accepted, pose)
        self._known[position].append((pose, answer))
        return answer

    @staticmethod
    def _count(poses: dict[tuple[float, ...], list[FloatArray]], pose: FloatArray) -> int:
        return sum(_same_orientation(other, pose) for other in poses.get(_position(pose), ()))


def _poses_by_position(
    targets: Sequence[TimedPose],
) -> dict[tuple[float, ...], list[FloatArray]]:
    poses: dict[tuple[float, ...], list[FloatArray]] = defaultdict(list)
    for target in targets:
        poses[_position(target.pose)].append(target.pose)
    return poses


def _first_two_fitting(
    sent: Sequence[TimedPose], candidates: Iterable[int], answer: TimedPose
) -> list[int]:
    fitting: list[int] = []
    for index in candidates:
        if sent[index].time_ns > answer.time_ns:
            break
        if _same_orientation(sent[index].pose, answer.pose):
            fitting.append(index)
            if len(fitting) == 2:
                break
    return fitting


def _position(pose: FloatArray) -> tuple[float, ...]:
    return tuple(pose[:3].tolist())


def _same_orientation(first: FloatArray, second: FloatArray) -> bool:
    """Whether two quaternions, of any norm but zero, are the same rotation."""
    # Sent targets may hold anything; what is not finite fits nothing.
    with np.errstate(all="ignore"):
        norms = float(np.linalg.norm(first[3:]) * np.linalg.norm(second[3:]))
        product = abs(float(first[3:] @ second[3:]))
    return norms > 0 and 1.0 - product / norms <= _QUATERNION_TOLERANCE
