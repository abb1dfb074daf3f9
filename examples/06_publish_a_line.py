"""Move along a line and print the tracking error. Start ik_node and fake_robot first.

For an arm give all three its model: -p model:=ur5e to the nodes, ur5e to this.
"""

import math
import sys
import time

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose, Vector3Stamped

from annik_core import load_model
from msg_tools import pose_from_array


def on_error(error: Vector3Stamped) -> None:
    """The error of one target: target minus achieved position, base frame [m]."""
    arrived.append(math.hypot(error.vector.x, error.vector.y, error.vector.z))
    print(f"missed by {1000 * arrived[-1]:.5f} mm")


def on_diagnostics(array: DiagnosticArray) -> None:
    """Why a node refused last."""
    for status in array.status:
        values = {entry.key: entry.value for entry in status.values}
        reasons[status.name] = values.get("last refusal")


robot = load_model(sys.argv[1] if sys.argv[1:] else "gantry").robot
centre, upper = robot.joint_box.centre, robot.joint_box.upper
# A line in joint space, from the centre of the joint box on: every robot reaches its poses.
poses = robot.forward_kinematics.poses(np.linspace(centre, 0.7 * centre + 0.3 * upper, 51))
arrived: list[float] = []
reasons: dict[str, str | None] = {}
rclpy.init()
node = rclpy.create_node("line")
targets = node.create_publisher(Pose, "target_pose", 10)
errors = node.create_subscription(Vector3Stamped, "tracking_error/position", on_error, 10)
node.create_subscription(DiagnosticArray, "/diagnostics", on_diagnostics, 10)
print("waiting for ik_node and fake_robot")
while targets.get_subscription_count() < 1 or errors.get_publisher_count() < 1:
    rclpy.spin_once(node, timeout_sec=0.1)
for pose in poses:
    before, attempts = len(arrived), 0  # what is published before all nodes have met is lost
    while len(arrived) == before and attempts < 3:
        sent, attempts = time.monotonic(), attempts + 1
        targets.publish(pose_from_array(pose))
        while len(arrived) == before and time.monotonic() - sent < 1.0:  # a robot takes its time
            rclpy.spin_once(node, timeout_sec=0.1)
    if len(arrived) == before:
        sys.exit(f"target {before + 1} of {len(poses)} was refused or lost: {reasons}")
