"""The parameters of ``bag_recorder``. Needs no ROS."""

from __future__ import annotations

from dataclasses import dataclass

from annik_ros.parameters import parameter
from msg_tools.topics import TOPICS


@dataclass(frozen=True)
class BagRecorderParameters:
    """Parameters of ``bag_recorder``."""

    output: str = parameter(
        "",
        "Folder of the bag, new or empty; empty: annik_bag_<date>_<time>, where it was started.",
    )
    topics: tuple[str, ...] = parameter(
        tuple(topic.name for topic in TOPICS),
        "Topics to record, relative or absolute; by default all of annik's.",
    )
    duration: float = parameter(
        0.0,
        "How long to record once subscribed; 0: until stopped.",
        unit="s",
        minimum=0.0,
        maximum=1e9,
    )
