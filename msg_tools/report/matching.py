"""Match accepted targets with the sent ones, by their pose.

``target_pose`` has no stamp. ik_node copies the position of a target bit for bit; it may normalise
the quaternion.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from annik_core.pose import FloatArray

_QUATERNION_TOLERANCE: Final = 1e-9


class TargetMatches(NamedTuple):
    """The sent target of each accepted one."""

    sent: list[int | None]  #: for each accepted target the index of the sent one; None if unknown
    ambiguous: frozenset[int]  #: indices of the accepted targets that match several sent ones


class TimedPose(NamedTuple):
    """A pose in a message."""

    topic: str
    time_ns: int  #: send time, or receive time if that is unknown [ns since the epoch]
    pose: FloatArray  #: ``(7,)`` x, y, z [m], quaternion x, y, z, w


def match_targets(sent: Sequence[TimedPose], accepted: Sequence[TimedPose]) -> TargetMatches:
    """The sent target of each accepted one.

    In order of time, each accepted target takes the first sent one that has its pose, was sent
    before it, is not taken, and follows the last one taken on its topic: a node reads a topic in
    order, so skipped targets were refused or dropped. If there is none, a skipped one is taken,
    since messages of two publishers may arrive in another order than sent.

    If several sent targets match and more of that pose were sent than accepted, any of them may
    have been dropped: the match is ambiguous.
    """
    by_position: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for index in sorted(range(len(sent)), key=lambda i: sent[i].time_ns):
        by_position[_position(sent[index].pose)].append(index)
    census = _Census(sent, accepted)
    last_taken: dict[str, int] = defaultdict(lambda: -1)
    matches: list[int | None] = [None] * len(accepted)
    ambiguous: set[int] = set()
    for number in sorted(range(len(accepted)), key=lambda i: accepted[i].time_ns):
        target = accepted[number]
        free = by_position.get(_position(target.pose), [])
        in_order = (i for i in free if sent[i].time_ns > last_taken[sent[i].topic])
        found = _first_two_matching(sent, in_order, target)
        if not found:
            found = _first_two_matching(sent, free, target)
        if not found:
            continue
        # Taken even if ambiguous: the true match is not earlier.
        match = found[0]
        last_taken[sent[match].topic] = max(last_taken[sent[match].topic], sent[match].time_ns)
        free.remove(match)
        if len(found) > 1 and census.more_sent_than_accepted(target.pose):
            ambiguous.add(number)
        else:
            matches[number] = match
    return TargetMatches(matches, frozenset(ambiguous))


class _Census:
    """Number of sent and accepted targets of a pose; counted on demand, once per pose."""

    def __init__(self, sent: Sequence[TimedPose], accepted: Sequence[TimedPose]) -> None:
        self._sent = _poses_by_position(sent)
        self._accepted = _poses_by_position(accepted)
        self._known: dict[tuple[float, ...], list[tuple[FloatArray, bool]]] = defaultdict(list)

    def more_sent_than_accepted(self, pose: FloatArray) -> bool:
        position = _position(pose)
        for known, more in self._known[position]:
            if _same_orientation(known, pose):
                return more
        more = self._count(self._sent, pose) > self._count(self._accepted, pose)
        self._known[position].append((pose, more))
        return more

    @staticmethod
    def _count(poses: dict[tuple[float, ...], list[FloatArray]], pose: FloatArray) -> int:
        return sum(_same_orientation(other, pose) for other in poses.get(_position(pose), ()))


def _poses_by_position(targets: Sequence[TimedPose]) -> dict[tuple[float, ...], list[FloatArray]]:
    poses: dict[tuple[float, ...], list[FloatArray]] = defaultdict(list)
    for target in targets:
        poses[_position(target.pose)].append(target.pose)
    return poses


def _first_two_matching(
    sent: Sequence[TimedPose], candidates: Iterable[int], target: TimedPose
) -> list[int]:
    found: list[int] = []
    for index in candidates:
        if sent[index].time_ns > target.time_ns:
            break
        if _same_orientation(sent[index].pose, target.pose):
            found.append(index)
            if len(found) == 2:
                break
    return found


def _position(pose: FloatArray) -> tuple[float, ...]:
    return tuple(pose[:3].tolist())


def _same_orientation(first: FloatArray, second: FloatArray) -> bool:
    """Whether two quaternions of any norm but zero are the same rotation."""
    # Sent targets are unchecked; one that is not finite matches nothing.
    with np.errstate(all="ignore"):
        norms = float(np.linalg.norm(first[3:]) * np.linalg.norm(second[3:]))
        product = abs(float(first[3:] @ second[3:]))
    return norms > 0 and 1.0 - product / norms <= _QUATERNION_TOLERANCE
