"""Which of rclpy's executors calls a node back. Needs no ROS."""

from __future__ import annotations

from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    pass


class ExecutorChoice(Enum):
    """Which of rclpy's executors calls a node back."""

    EVENTS = "events"
    SINGLE_THREADED = "single_threaded"
