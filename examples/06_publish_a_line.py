"""Move along a line and print the tracking error. Start ik_node and fake_robot first."""

import math
import time

import rclpy
from geometry_msgs.msg import Pose, Vector3Stamped


def on_error(error: Vector3Stamped) -> None:
    """The error of one target: target minus achieved position, base frame [m]."""
    distance = math.hypot(error.vector.x, error.vector.y, error.vector.z)
    arrived.append(distance)
    print(f"missed by {1000 * distance:.5f} mm")


arrived: list[float] = []
rclpy.init()
node = rclpy.create_node("line")
targets = node.create_publisher(Pose, "target_pose", 10)
errors = node.create_subscription(Vector3Stamped, "tracking_error/position", on_error, 10)
print("waiting for ik_node and fake_robot")
while targets.get_subscription_count() < 1 or errors.get_publisher_count() < 1:
    rclpy.spin_once(node, timeout_sec=0.1)
for step in range(51):
    pose = Pose()  # [m], unit quaternion; fields take floats only, an int would be sent as garbage
    pose.position.x = 0.25 + 0.004 * step
    pose.position.y, pose.position.z, pose.orientation.w = 0.3, 0.6, 1.0
    before, sent = len(arrived), time.monotonic()
    targets.publish(pose)
    while len(arrived) == before and time.monotonic() - sent < 1.0:  # a robot takes its time
        rclpy.spin_once(node, timeout_sec=0.1)
rclpy.shutdown()
