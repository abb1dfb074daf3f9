"""The parameters of ``bag_recorder``. Needs no ROS."""

from dataclasses import dataclass

from annik_ros.parameters import parameter
from msg_tools.topics import TOPICS


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of ``bag_recorder``."""

    output: str = parameter(
        "",
        "Folder of the bag, new or empty. Default: annik_bag_<date>_<time>, in the working "
        "directory.",
    )
    topics: tuple[str, ...] = parameter(
        tuple(topic.name for topic in TOPICS),
        "Topics to record, relative or absolute; by default all topics of annik.",
    )
    duration: float = parameter(
        0.0, "How long to record after subscribing; 0: until stopped.", unit="s", within=(0.0, 1e9)
    )
