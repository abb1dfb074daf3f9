"""Qualities of service that the nodes share."""

from __future__ import annotations

from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

#: Results are few and each matters: none is left out unless a reader is this far behind.
RESULT_DEPTH = 1000


def reliable(depth: int) -> QoSProfile:
    """Reliable delivery that keeps the last ``depth`` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.RELIABLE
    )
