"""Quality of service of the nodes."""

from rclpy.qos import QoSProfile, ReliabilityPolicy

#: Depth for results: none is dropped unless a subscriber is this many messages behind.
RESULT_DEPTH = 1000


def reliable(depth: int) -> QoSProfile:
    """Reliable delivery that keeps the last ``depth`` messages."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def best_effort(depth: int) -> QoSProfile:
    """Delivery from any publisher, without repetition, that keeps the last ``depth`` messages."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
