"""ROS messages to numpy arrays and back, bags, and the report of a bag.

The names below are loaded on first use: bags are read without the ROS message packages.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

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
_MODULES = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a public name on first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted(__all__)
