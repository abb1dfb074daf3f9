"""Which of rclpy's executors calls a node back. Needs no ROS."""

from __future__ import annotations

from enum import Enum


class ExecutorChoice(Enum):
    """Which of rclpy's executors calls a node back."""

    EVENTS = "events"
    SINGLE_THREADED = "single_threaded"
