"""Publish a few target poses from a script of your own, then see what came of them.

Start ik_node and fake_robot first. Poses are of the end effector in the base frame: metres, and a
unit quaternion in the order x, y, z, w.
"""

import math
import sys

import rclpy
from geometry_msgs.msg import Pose, Vector3Stamped
from rclpy.node import Node

TARGETS = 10


class PosePublisher(Node):
    """Moves on to the next pose when the tracking error of the last one has arrived."""

    def __init__(self) -> None:
        super().__init__("pose_publisher")
        self.arrived = 0
        self._publisher = self.create_publisher(Pose, "target_pose", 10)
        self.create_subscription(Vector3Stamped, "tracking_error/position", self._on_error, 10)
        # Repeats a target until it is answered: at first the nodes may not know of each other.
        self.create_timer(0.2, self._publish)

    def _publish(self) -> None:
        pose = Pose()
        # Fields want floats: an integer would be sent as a different number.
        pose.position.x = 0.25 + 0.02 * self.arrived
        pose.position.y = 0.3
        pose.position.z = 0.6
        yaw = math.radians(5.0 * self.arrived)
        pose.orientation.z = math.sin(yaw / 2)
        pose.orientation.w = math.cos(yaw / 2)
        self._publisher.publish(pose)

    def _on_error(self, error: Vector3Stamped) -> None:
        norm = math.hypot(error.vector.x, error.vector.y, error.vector.z)
        print(f"target {self.arrived}: missed by {1000 * norm:.5f} mm")
        self.arrived += 1


def main() -> None:
    """Publish until every target is answered."""
    rclpy.init()
    node = PosePublisher()
    try:
        while node.arrived < TARGETS:
            rclpy.spin_once(node)
    except KeyboardInterrupt:
        sys.exit("interrupted")
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
