"""Start an ik_node, send it a target, and time the command that comes back."""

import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import rclpy
from geometry_msgs.msg import Pose
from sensor_msgs.msg import JointState

from annik_core.model.artifact import load_model
from annik_ros.processes import ChildProcess
from annik_ros.qos import reliable
from msg_tools.conversions.pose import pose_from_array
from msg_tools.topics import JOINT_COMMAND, TARGET_POSE

#: Longest wait for a command [s]; a loaded machine is slow to start Python.
TIMEOUT = 60.0
#: Time between two targets [s] until the first command: before discovery, targets are lost.
_PERIOD = 0.05
#: Time without a command [s] after which none is on its way any more.
_QUIET = 0.25
_TRIPS = 20


def round_trip(model: Path) -> tuple[float, float] | None:
    """Time the round trip of a target to an ik_node of its own, in a namespace of its own.

    Returns:
        Time from the start of the process to its first command, and the median time from a target
        to its command once both have met [s]; None if a command takes longer than
        :data:`TIMEOUT`.
    """
    namespace = f"/annik_doctor_{os.getpid()}"
    robot = load_model(model).robot
    target = pose_from_array(robot.forward_kinematics.poses(robot.joint_box.centre[None])[0])
    command = [sys.executable, "-m", "annik_ros.ik_node.node", "--ros-args"]
    command += ["-r", f"__ns:={namespace}", "-p", f"model:={model}"]
    rclpy.init(args=[])
    node = rclpy.create_node("annik_doctor")
    arrivals: list[float] = []
    publisher = node.create_publisher(Pose, f"{namespace}/{TARGET_POSE.name}", reliable(1))
    node.create_subscription(
        JointState,
        f"{namespace}/{JOINT_COMMAND.name}",
        lambda _: arrivals.append(time.perf_counter()),
        reliable(100),
    )

    def trip(timeout: float) -> float | None:
        """The time from a target to the next command [s], or None after ``timeout`` [s]."""
        arrivals.clear()
        begin = time.perf_counter()
        publisher.publish(target)
        while not arrivals and (left := begin + timeout - time.perf_counter()) > 0:
            rclpy.spin_once(node, timeout_sec=left)
        return arrivals[0] - begin if arrivals else None

    try:
        with tempfile.TemporaryDirectory() as folder:
            begin = time.perf_counter()
            with ChildProcess(command, Path(folder) / "ik_node.log", os.environ):
                while trip(_PERIOD) is None:
                    if time.perf_counter() - begin > TIMEOUT:
                        return None
                start = arrivals[0] - begin
                while arrivals:  # commands for targets that were sent more than once
                    arrivals.clear()
                    rclpy.spin_once(node, timeout_sec=_QUIET)
                trips: list[float] = []
                while len(trips) < _TRIPS:
                    duration = trip(TIMEOUT)
                    if duration is None:
                        return None
                    trips.append(duration)
        return start, median(trips)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
