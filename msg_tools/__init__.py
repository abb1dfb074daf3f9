"""ROS messages to numpy arrays and back, bags, and the report of a bag.

The names below are loaded on first use: bags are read without the ROS message packages.
"""

from typing import TYPE_CHECKING

from annik_core.lazy import lazy_names

if TYPE_CHECKING:
    from msg_tools.bags.errors import BagNotFound, BagNotReadable
    from msg_tools.bags.reader import Bag, read_bag
    from msg_tools.bags.writer import BagWriter
    from msg_tools.conversions.joint_state import joint_state_from_array, joint_state_to_array
    from msg_tools.conversions.pose import pose_from_array, pose_stamped_from_array, pose_to_array
    from msg_tools.report.tracking import TrackingReport, tracking_report
    from msg_tools.report.write import write_report

__all__ = [
    "Bag",
    "BagNotFound",
    "BagNotReadable",
    "BagWriter",
    "TrackingReport",
    "joint_state_from_array",
    "joint_state_to_array",
    "pose_from_array",
    "pose_stamped_from_array",
    "pose_to_array",
    "read_bag",
    "tracking_report",
    "write_report",
]

_NAMES = {
    "bags.errors": ("BagNotFound", "BagNotReadable"),
    "bags.reader": ("Bag", "read_bag"),
    "bags.writer": ("BagWriter",),
    "conversions.joint_state": ("joint_state_from_array", "joint_state_to_array"),
    "conversions.pose": ("pose_from_array", "pose_stamped_from_array", "pose_to_array"),
    "report.tracking": ("TrackingReport", "tracking_report"),
    "report.write": ("write_report",),
}
__getattr__, __dir__ = lazy_names(__name__, _NAMES)
