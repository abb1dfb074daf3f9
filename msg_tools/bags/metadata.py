"""The ``metadata.yaml`` of a rosbag2 directory, format version 9."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import yaml
from rosbags.interfaces import Qos, QosTime

from msg_tools.bags.types import type_hash

METADATA_FILE = "metadata.yaml"


@dataclass
class RecordedTopic:
    """What a bag's metadata says about one topic.

    Attributes:
        name: absolute topic name.
        type: message type, known to :mod:`msg_tools.bags.types`.
        offered_qos: quality of service of its publishers, as far as known.
        message_count: messages in the bag.
    """

    name: str
    type: str
    offered_qos: tuple[Qos, ...] = ()
    message_count: int = 0


@dataclass
class RecordedSpan:
    """First and last receive time of a bag's messages [ns since the epoch].

    Attributes:
        first: None while there is no message.
        last: None while there is no message.
    """

    first: int | None = field(default=None)
    last: int | None = field(default=None)

    def include(self, time: int) -> None:
        """Widen the span to a receive time [ns since the epoch]."""
        self.first = time if self.first is None else min(self.first, time)
        self.last = time if self.last is None else max(self.last, time)

    @property
    def duration(self) -> int:
        """Length [ns]; 0 while there is no message."""
        return 0 if self.first is None or self.last is None else self.last - self.first


def qos_text(offered_qos: Sequence[Qos]) -> str:
    """Quality of service in the YAML form that an MCAP channel of a bag carries."""
    return _dump([_qos_entry(qos) for qos in offered_qos]).strip()


def metadata_text(file_name: str, topics: Sequence[RecordedTopic], span: RecordedSpan) -> str:
    """Text of ``metadata.yaml`` for a bag of one MCAP file."""
    return _dump({"rosbag2_bagfile_information": bag_information(file_name, topics, span)})


def bag_information_text(
    file_name: str, topics: Sequence[RecordedTopic], span: RecordedSpan
) -> str:
    """The same without its outer key, as rosbag2 keeps it inside the MCAP file."""
    return _dump(bag_information(file_name, topics, span))


def bag_information(
    file_name: str, topics: Sequence[RecordedTopic], span: RecordedSpan
) -> Mapping[str, Any]:
    """The contents of ``metadata.yaml`` under ``rosbag2_bagfile_information``.

    Args:
        file_name: of the MCAP file, relative to the bag.
        topics: all topics of the bag.
        span: of its messages.
    """
    message_count = sum(topic.message_count for topic in topics)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        **_extent(span, message_count),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [_qos_entry(qos) for qos in topic.offered_qos],
                    "type_description_hash": type_hash(topic.type),
                },
                "message_count": topic.message_count,
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **_extent(span, message_count)}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _extent(span: RecordedSpan, message_count: int) -> dict[str, Any]:
    # A new dictionary each time: YAML would write a shared one as an alias.
    return {
        "starting_time": {"nanoseconds_since_epoch": span.first or 0},
        "duration": {"nanoseconds": span.duration},
        "message_count": message_count,
    }


def _qos_entry(qos: Qos) -> dict[str, Any]:
    return {
        "history": qos.history.name.lower(),
        "depth": qos.depth,
        "reliability": qos.reliability.name.lower(),
        "durability": qos.durability.name.lower(),
        "deadline": _time_entry(qos.deadline),
        "lifespan": _time_entry(qos.lifespan),
        "liveliness": qos.liveliness.name.lower(),
        "liveliness_lease_duration": _time_entry(qos.liveliness_lease_duration),
        "avoid_ros_namespace_conventions": qos.avoid_ros_namespace_conventions,
    }


def _time_entry(time: QosTime) -> dict[str, int]:
    return {"sec": time.sec, "nsec": time.nsec}


def _dump(content: object) -> str:
    text: str = yaml.safe_dump(content, sort_keys=False)
    return text
