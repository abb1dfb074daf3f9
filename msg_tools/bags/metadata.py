"""What a bag says of itself: message types, and ``metadata.yaml`` of format version 9."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import yaml
from rosbags.interfaces import Qos
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

METADATA_FILE = "metadata.yaml"


@dataclass
class RecordedTopic:
    """One topic in a bag's metadata: absolute name, message type, count."""

    name: str
    type: str
    offered_qos: tuple[Qos, ...] = ()
    message_count: int = 0


@dataclass
class RecordedSpan:
    """First and last receive time of a bag's messages [ns since the epoch]; None without any."""

    first: int | None = None
    last: int | None = None

    def include(self, time: int) -> None:
        """Widen the span to a receive time [ns since the epoch]."""
        self.first = time if self.first is None else min(self.first, time)
        self.last = time if self.last is None else max(self.last, time)

    @property
    def duration(self) -> int:
        """Length [ns]; 0 while there is no message."""
        return 0 if self.first is None or self.last is None else self.last - self.first


@cache
def jazzy_types() -> Typestore:
    """The store of the message types that come with ROS 2 Jazzy; shared: do not extend it."""
    return get_typestore(Stores.ROS2_JAZZY)


def is_known_type(message_type: str) -> bool:
    """Whether a type, such as ``geometry_msgs/msg/Pose``, comes with ROS 2 Jazzy."""
    return message_type in jazzy_types().fielddefs


def qos_text(offered_qos: Sequence[Qos]) -> str:
    """Quality of service in the YAML form that an MCAP channel of a bag carries."""
    return yaml_text(dump_qos_v9(list(offered_qos))).strip()


def bag_information(
    file_name: str, topics: Sequence[RecordedTopic], span: RecordedSpan
) -> Mapping[str, Any]:
    """What ``metadata.yaml`` has under ``rosbag2_bagfile_information``, for one MCAP file."""
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
                    "offered_qos_profiles": dump_qos_v9(list(topic.offered_qos)),
                    "type_description_hash": jazzy_types().hash_rihs01(topic.type),
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


def yaml_text(content: object) -> str:
    """Content in the YAML of a bag, its keys in their order."""
    text: str = yaml.safe_dump(content, sort_keys=False)
    return text
