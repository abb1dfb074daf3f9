"""Targets in other frames than the base frame, by tf2 where it is installed."""

from importlib import import_module
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from annik_core.errors import AnnikError
from annik_core.pose import checked_pose, transformed
from msg_tools.conversions.cdr import StampedPoses
from msg_tools.conversions.pose import transform_to_array
from msg_tools.conversions.stamp import stamp_to_nanoseconds


class NoTransform(AnnikError):
    """tf2 has no transform from the frame of a target to the base frame, or none of now."""


class TargetFrames:
    """Listens to tf for a node, unless ``timeout`` [s] is 0 or tf2_ros is not installed.

    ``timeout`` is how far the stamp of a transform may be from the present time.
    """

    def __init__(self, node: Node, timeout: float) -> None:
        self._node = node
        self._timeout = timeout
        self._buffer: Any = None
        if timeout == 0.0:
            return
        try:
            tf2_ros = import_module("tf2_ros")
        except ImportError:
            return
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, node)
        # After a simulation has begun anew, the newest transforms would be those before it.
        back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1))
        self._jumps = node.get_clock().create_jump_callback(
            back, post_callback=lambda _: self._buffer.clear()
        )

    def in_base_frame(self, target: StampedPoses, base_frame: str) -> StampedPoses:
        """A target by the newest transform to the base frame; without tf2, as it is.

        Raises:
            NoTransform: if there is none near the present time.
        """
        frame = target.frame_id
        if self._buffer is None or frame in ("", base_frame):
            return target
        failed = f"the target is in frame {frame!r}, and not transformed to {base_frame!r}"
        try:
            # Time zero is the newest. It never waits, since tf arrives in this thread too.
            found = self._buffer.lookup_transform(base_frame, frame, Time())
            transform = checked_pose(transform_to_array(found.transform))
            stamp = stamp_to_nanoseconds(found.header.stamp)
            if not stamp:
                # Static, which holds at any time; or not stamped, and then of any age.
                self._buffer.lookup_transform(base_frame, frame, self._node.get_clock().now())
        # tf2 has many errors, and with any of them the target must be refused.
        except Exception as error:
            raise NoTransform(f"{failed}: {error}") from error
        age = 1e-9 * (self._node.get_clock().now().nanoseconds - stamp)
        if stamp and not abs(age) <= self._timeout:
            raise NoTransform(f"{failed}: the newest is {age:.3g} s old, see transform_timeout")
        return StampedPoses(target.nanoseconds, base_frame, transformed(transform, target.poses))
