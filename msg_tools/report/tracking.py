"""Tracking error of a robot, computed from a bag."""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from scipy.spatial.transform import Rotation

from annik_core.errors import ConversionError
from annik_core.pose import FloatArray, TrackingError, checked_pose, tracking_error
from msg_tools import topics
from msg_tools.bags.progress import Progress
from msg_tools.bags.reader import Bag, BagRecord
from msg_tools.report.matching import TimedPose, match_targets
from msg_tools.report.namespace import robot_namespace
from msg_tools.report.refusals import RefusalCounts, refusal_history

#: Recorded and recomputed tracking errors may differ by this much [m and rad].
ERROR_AGREEMENT: Final = 1e-9
#: Coordinates beyond this [m] are taken as damage; they could overflow.
LARGEST_COORDINATE: Final = 1e6


class TargetResult(NamedTuple):
    """A target with a command and an achieved pose."""

    number: int  #: 1, 2, ... in order of acceptance
    stamp_ns: int  #: header stamp of the target, its command and its result [ns]
    target: tuple[float, float, float]  #: x, y, z [m] in the base frame
    achieved: tuple[float, float, float]  #: x, y, z [m] in the base frame
    position_error_mm: float
    orientation_error_deg: float
    #: Time from the target's message to its command's [us]; None if unknown.
    latency_us: float | None


class Summary(NamedTuple):
    """Percentiles of a quantity, in its unit."""

    p50: float
    p95: float
    p99: float
    max: float


@dataclass(frozen=True)
class TrackingReport:
    """Report of a bag on the tracking of one robot."""

    bag_path: Path
    namespace: str  #: of the robot, with its leading slash
    targets_sent: int  #: messages on the target topics
    targets_answered: int  #: commands
    #: Targets without a command: refused, or replaced by a newer one in the queue.
    targets_unanswered: int
    #: Count of the ik_node's last diagnostics; without diagnostics, all targets without a command.
    targets_refused: int
    #: Refused targets by reason, from the last diagnostics; most frequent first.
    refusal_reasons: dict[str, int]
    #: The last of them in words, with the value and what is allowed; may be empty.
    last_refusal: str
    #: What the diagnostics counted, whenever it changed.
    refusals: tuple[RefusalCounts, ...]
    #: Targets with a command and a result, in order of acceptance.
    targets: tuple[TargetResult, ...]
    position_error_mm: Summary | None  #: over ``targets`` [mm]; None if there are none
    orientation_error_deg: Summary | None  #: over ``targets`` [deg]; None if there are none
    #: Target to command [us], over the targets that were matched; None if none.
    latency_us: Summary | None
    latency_clock: str  #: ``sent`` or ``received``: the times that the latency is computed from
    #: Largest difference between the recorded tracking errors and those recomputed here, [m] and
    #: [rad]; None if nothing can be compared.
    recorded_error_difference: tuple[float, float] | None
    bag_complete: bool
    notes: tuple[str, ...]  #: remarks for the reader, in sentences

    @property
    def why_refused(self) -> str:
        """How many targets were refused and why, in sentences; empty if none was."""
        if not self.targets_refused:
            return ""
        counts = ", ".join(f"{reason} ({count})" for reason, count in self.refusal_reasons.items())
        last = f" The last: {self.last_refusal.rstrip('.')}." if self.last_refusal else ""
        return (
            f"{self.targets_refused} targets were refused: {counts or 'the reasons are unknown'}."
            f"{last}"
        )

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON values; None where there is no number."""
        return {
            "bag": str(self.bag_path),
            "bag_complete": self.bag_complete,
            "namespace": self.namespace,
            "targets_sent": self.targets_sent,
            "targets_answered": self.targets_answered,
            "targets_unanswered": self.targets_unanswered,
            "targets_refused": self.targets_refused,
            "targets_paired": len(self.targets),
            "refusal_reasons": self.refusal_reasons,
            "last_refusal": self.last_refusal,
            "position_error_mm": _summary_entries(self.position_error_mm),
            "orientation_error_deg": _summary_entries(self.orientation_error_deg),
            "latency_us": _summary_entries(self.latency_us),
            "latency_clock": self.latency_clock,
            "recorded_error_difference": None
            if self.recorded_error_difference is None
            else dict(zip(("m", "rad"), self.recorded_error_difference, strict=True)),
            "notes": list(self.notes),
        }


class _Record(NamedTuple):
    """What is kept of a message: a long bag of decoded messages would fill the memory."""

    topic: str
    log_time_ns: int
    publish_time_ns: int
    stamp_ns: int  #: of the header; 0 without a header
    content: Any  #: see ``_READ``


class _Pair(NamedTuple):
    stamp: int
    target: FloatArray
    achieved: FloatArray
    error: TrackingError
    latency_us: float | None


class _Latencies(NamedTuple):
    """Time from target to command [us] by stamp, and the stamps for which it is ambiguous."""

    known: dict[int, float]
    ambiguous: frozenset[int]


def tracking_report(
    bag: Bag, namespace: str | None = None, progress: Progress | None = None
) -> TrackingReport:
    """Compute the report of a bag; the namespace of the robot is needed if it holds several.

    Raises:
        NamespaceError: see :func:`msg_tools.report.namespace.robot_namespace`.
        BagNotReadable: if a message that is needed can't be decoded.
    """
    chosen = robot_namespace(bag, namespace)
    names = {
        topic: topic if topic.startswith("/") else f"{chosen.rstrip('/')}/{topic}"
        for topic in _READ
    }
    records: dict[str, list[_Record]] = defaultdict(list)
    by_name = {name: topic for topic, name in names.items()}
    for record in bag.records(by_name, progress):
        records[by_name[record.topic]].append(_kept(record, by_name[record.topic]))
    notes = [f"The bag is damaged. {fault}." for fault in bag.damage]

    pairs, ambiguous = _pairs(records, bag, notes)
    sent = len(records[topics.TARGET_POSE.name]) + len(records[topics.TARGET_POSE_STAMPED.name])
    answered = len(records[topics.JOINT_COMMAND.name])
    if not pairs:
        notes.insert(0, _why_no_pairs(records, names, sent, answered))
    if answered > sent:
        notes.append(
            f"There are more commands ({answered}) than targets ({sent}): "
            "not all targets were recorded."
        )
    unanswered = max(0, sent - answered)
    by_time = sorted(records[topics.DIAGNOSTICS.name], key=lambda record: record.log_time_ns)
    refusals = refusal_history((record.content for record in by_time), chosen)
    counts = refusals[-1] if refusals else None
    if counts is None and unanswered:
        notes.append(
            "The bag holds no diagnostics of the ik_node: every target without a command is "
            "counted as refused, and the reasons are unknown."
        )
    elif counts is not None and counts.refused != unanswered:
        notes.append(
            f"{unanswered} targets have no command, but the ik_node's last diagnostics count "
            f"{counts.refused} as refused: these may be one second old, count from the node's "
            "start, and leave out targets that a newer one replaced in the queue."
        )
    targets = tuple(_target_result(number, pair) for number, pair in enumerate(pairs, start=1))
    latencies = [target.latency_us for target in targets if target.latency_us is not None]
    unrecognised = len(targets) - len(latencies) - ambiguous
    if unrecognised:
        notes.append(
            f"{unrecognised} of {len(targets)} answered targets were not "
            "recognised among the sent ones: their latency is unknown."
        )
    if ambiguous:
        notes.append(
            f"{ambiguous} of {len(targets)} answered targets are equal to several sent ones, not "
            "all of which were answered: their latency is unknown."
        )
    if latencies and not bag.has_publish_times:
        notes.append(
            "The bag has no send times: latency is computed from the times at which the recorder "
            "received the messages."
        )
    difference = _recorded_error_difference(pairs, records, notes)
    return TrackingReport(
        bag_path=bag.path,
        namespace=chosen,
        targets_sent=sent,
        targets_answered=answered,
        targets_unanswered=unanswered,
        targets_refused=unanswered if counts is None else counts.refused,
        refusal_reasons=counts.reasons if counts is not None else {},
        last_refusal=counts.last if counts is not None else "",
        refusals=refusals,
        targets=targets,
        position_error_mm=_summary([target.position_error_mm for target in targets]),
        orientation_error_deg=_summary([target.orientation_error_deg for target in targets]),
        latency_us=_summary(latencies),
        latency_clock="sent" if bag.has_publish_times else "received",
        recorded_error_difference=difference,
        bag_complete=bag.complete,
        notes=tuple(notes),
    )


def _pairs(
    records: dict[str, list[_Record]], bag: Bag, notes: list[str]
) -> tuple[list[_Pair], int]:
    """Accepted targets with their achieved poses, by stamp; how many latencies are ambiguous."""
    accepted = _by_stamp(records[topics.ACCEPTED_TARGET.name], "accepted targets", notes)
    achieved = _by_stamp(records[topics.ACHIEVED_POSE.name], "achieved poses", notes)
    commands = _by_stamp(records[topics.JOINT_COMMAND.name], "commands", notes)
    latencies = _latencies(records, accepted, commands, bag)
    pairs = []
    invalid = 0
    for stamp in sorted(accepted.keys() & achieved.keys()):
        try:
            target = checked_pose(accepted[stamp].content)
            result = checked_pose(achieved[stamp].content)
        except ConversionError:
            invalid += 1
            continue
        if max(np.abs(target[:3]).max(), np.abs(result[:3]).max()) > LARGEST_COORDINATE:
            invalid += 1
            continue
        error = tracking_error(target, result)
        pairs.append(_Pair(stamp, target, result, error, latencies.known.get(stamp)))
    if invalid:
        notes.append(
            f"{invalid} pairs hold an invalid pose (NaN, no unit quaternion, or farther than "
            f"{LARGEST_COORDINATE:g} m): they are left out."
        )
    without_result = len(accepted.keys() - achieved.keys())
    if pairs and without_result:
        notes.append(f"{without_result} accepted targets have no achieved pose in the bag.")
    without_command = len(accepted.keys() - commands.keys())
    if pairs and without_command:
        notes.append(f"{without_command} accepted targets have no command in the bag.")
    return pairs, sum(pair.stamp in latencies.ambiguous for pair in pairs)


def _latencies(
    records: dict[str, list[_Record]],
    accepted: dict[int, _Record],
    commands: dict[int, _Record],
    bag: Bag,
) -> _Latencies:
    def time(record: _Record) -> int:
        return record.publish_time_ns if bag.has_publish_times else record.log_time_ns

    sent = [
        TimedPose(record.topic, time(record), record.content)
        for topic in (topics.TARGET_POSE, topics.TARGET_POSE_STAMPED)
        for record in records[topic.name]
    ]
    stamps = sorted(accepted.keys() & commands.keys())
    answers = [
        TimedPose(accepted[stamp].topic, time(accepted[stamp]), accepted[stamp].content)
        for stamp in stamps
    ]
    matches = match_targets(sent, answers)
    known = {
        stamp: (time(commands[stamp]) - sent[match].time_ns) / 1e3
        for stamp, match in zip(stamps, matches.sent, strict=True)
        if match is not None
    }
    return _Latencies(known, frozenset(stamps[number] for number in matches.ambiguous))


def _recorded_error_difference(
    pairs: Sequence[_Pair], records: dict[str, list[_Record]], notes: list[str]
) -> tuple[float, float] | None:
    positions = _by_stamp(records[topics.POSITION_ERROR.name], "position errors", notes)
    orientations = _by_stamp(records[topics.ORIENTATION_ERROR.name], "orientation errors", notes)
    both = [pair for pair in pairs if pair.stamp in positions and pair.stamp in orientations]
    if not both:
        if pairs:
            notes.append("The bag holds no recorded tracking errors to compare with.")
        return None
    recorded_positions = np.array([positions[p.stamp].content for p in both])
    recorded_rotations = np.array([orientations[p.stamp].content for p in both])
    # A NaN is not valid, so not '>'.
    valid = (np.abs(recorded_positions) <= 2 * LARGEST_COORDINATE).all(axis=1)
    valid &= (np.abs(recorded_rotations) <= LARGEST_COORDINATE).all(axis=1)
    if not valid.all():
        notes.append(
            f"{np.count_nonzero(~valid)} recorded tracking errors are no numbers, or too large: "
            "they disagree with those recomputed."
        )
    if not valid.any():
        return None
    both = [pair for pair, good in zip(both, valid, strict=True) if good]
    recorded_positions, recorded_rotations = recorded_positions[valid], recorded_rotations[valid]
    position_difference = np.linalg.norm(
        recorded_positions - np.array([pair.error.position for pair in both]), axis=1
    ).max()
    # As rotations: a rotation vector of half a turn equals its negative.
    recomputed = Rotation.from_rotvec(np.array([pair.error.orientation for pair in both]))
    difference = Rotation.from_rotvec(recorded_rotations) * recomputed.inv()
    rotation_difference = difference.magnitude().max()
    if max(position_difference, rotation_difference) > ERROR_AGREEMENT:
        notes.append(
            "The recorded tracking errors disagree with those recomputed from "
            f"accepted_target and achieved_pose by up to {position_difference:.3g} m and "
            f"{rotation_difference:.3g} rad."
        )
    return float(position_difference), float(rotation_difference)


def _by_stamp(records: Sequence[_Record], what: str, notes: list[str]) -> dict[int, _Record]:
    """Records by header stamp [ns]; a stamp that occurs twice pairs with nothing."""
    found: dict[int, _Record] = {}
    repeated: set[int] = set()
    for record in records:
        if record.stamp_ns in found:
            repeated.add(record.stamp_ns)
        found[record.stamp_ns] = record
    for stamp in repeated:
        del found[stamp]
    if repeated:
        notes.append(f"{len(repeated)} stamps occur on several {what}: they are left out.")
    return found


def _why_no_pairs(
    records: dict[str, list[_Record]], names: dict[str, str], sent: int, answered: int
) -> str:
    if sent and not answered:
        return f"There is nothing to compare: none of {sent} targets has a command."
    needed = (topics.ACCEPTED_TARGET, topics.ACHIEVED_POSE)
    missing = [names[topic.name] for topic in needed if not records[topic.name]]
    if missing:
        return (
            f"There is nothing to compare: the bag holds no message on {' and '.join(missing)}. "
            "Record them too, with bag_recorder or 'ros2 bag record'."
        )
    counts = [f"{names[topic.name]} ({len(records[topic.name])} messages)" for topic in needed]
    return (
        f"There is nothing to compare: {' and '.join(counts)} share no stamp with a valid pose. "
        "The achieved pose must carry the stamp of its command."
    )


def _target_result(number: int, pair: _Pair) -> TargetResult:
    return TargetResult(
        number=number,
        stamp_ns=pair.stamp,
        target=(float(pair.target[0]), float(pair.target[1]), float(pair.target[2])),
        achieved=(float(pair.achieved[0]), float(pair.achieved[1]), float(pair.achieved[2])),
        position_error_mm=float(np.linalg.norm(pair.error.position)) * 1e3,
        orientation_error_deg=float(np.degrees(np.linalg.norm(pair.error.orientation))),
        latency_us=pair.latency_us,
    )


def _summary(values: Sequence[float]) -> Summary | None:
    if not values:
        return None
    p50, p95, p99 = np.percentile(values, [50, 95, 99])
    return Summary(float(p50), float(p95), float(p99), float(max(values)))


def _summary_entries(summary: Summary | None) -> dict[str, float | None]:
    return dict.fromkeys(Summary._fields) if summary is None else dict(summary._asdict())


def _kept(record: BagRecord, topic: str) -> _Record:
    message = record.message
    stamp_ns = 0
    if topic != topics.TARGET_POSE.name:
        stamp_ns = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
    return _Record(
        record.topic, record.log_time_ns, record.publish_time_ns, stamp_ns, _READ[topic](message)
    )


def _pose(message: Pose) -> FloatArray:
    p, q = message.position, message.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


def _vector(message: Vector3) -> tuple[float, float, float]:
    return message.x, message.y, message.z


#: The topics that are read, and what is kept of a message of each besides times and stamp.
_READ: Final[Mapping[str, Callable[[Any], Any]]] = {
    topics.TARGET_POSE.name: _pose,
    topics.TARGET_POSE_STAMPED.name: lambda message: _pose(message.pose),
    topics.ACCEPTED_TARGET.name: lambda message: _pose(message.pose),
    topics.JOINT_COMMAND.name: lambda message: None,
    topics.ACHIEVED_POSE.name: lambda message: _pose(message.pose),
    topics.POSITION_ERROR.name: lambda message: _vector(message.vector),
    topics.ORIENTATION_ERROR.name: lambda message: _vector(message.vector),
    topics.DIAGNOSTICS.name: lambda message: message,
}
