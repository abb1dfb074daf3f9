"""Start an ik_node, send it a target, and wait for the command."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from geometry_msgs.msg import Pose
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

from annik_core.artifact import load_artifact
from annik_core.errors import AnnikError
from annik_ros.child_process import ChildProcess
from annik_ros.qos import reliable
from msg_tools.pose import pose_to_message
from msg_tools.topics import JOINT_COMMAND, TARGET_POSE

#: Longest wait for the first command [s]; a loaded machine is slow to start Python.
_TIMEOUT = 20.0
#: Time between two targets until the first command arrives [s]: who is not yet discovered misses
#: what is sent.
_PERIOD = 0.05
_TRIPS = 20


class NoAnswer(AnnikError):
    """No command arrived in time."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout
        super().__init__(f"nothing arrived within {timeout:g} s")


def round_trip(model: Path) -> tuple[float, float]:
    """Ask an ik_node of its own, in a namespace that nobody else uses.

    Args:
        model: the model file that it serves.

    Returns:
        Time from the start of its process to its first command, and from a target to its command
        once they have met, the median of some [s].

    Raises:
        AnnikError: if no command arrives.
    """
    namespace = f"/annik_doctor_{os.getpid()}"
    command = [sys.executable, "-m", "annik_ros.ik_node", "--ros-args"]
    command += ["-r", f"__ns:={namespace}", "-p", f"model:={model}"]
    robot = load_artifact(model).robot
    centre = robot.forward_kinematics.poses(robot.joint_box.centre[None])[0]
    target = pose_to_message(centre)
    rclpy.init(args=[])
    node = Node("annik_doctor", namespace=namespace)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        received: list[JointState] = []
        node.create_subscription(JointState, JOINT_COMMAND.name, received.append, reliable(10))
        publisher = node.create_publisher(Pose, TARGET_POSE.name, reliable(1))

        def ask(period: float) -> float:
            """Time until a command arrives, with a target sent every ``period`` [s]."""
            received.clear()
            begin = time.perf_counter()
            while time.perf_counter() - begin < _TIMEOUT:
                publisher.publish(target)
                if _spin_until(executor, lambda: bool(received), period):
                    return time.perf_counter() - begin
            raise NoAnswer(_TIMEOUT)

        with (
            tempfile.TemporaryDirectory() as folder,
            ChildProcess(command, Path(folder) / "ik_node.log", os.environ),
        ):
            start = ask(_PERIOD)
            # What was sent too often is answered too.
            _spin_until(executor, lambda: False, 4 * _PERIOD)
            trips = sorted(ask(_TIMEOUT) for _ in range(_TRIPS))
        return start, trips[_TRIPS // 2]
    finally:
        executor.shutdown(timeout_sec=0.0)
        node.destroy_node()
        rclpy.try_shutdown()


def _spin_until(
    executor: SingleThreadedExecutor, condition: Callable[[], bool], timeout: float
) -> bool:
    """Take messages until the condition holds; whether it does before ``timeout`` [s]."""
    deadline = time.perf_counter() + timeout
    while not condition():
        left = deadline - time.perf_counter()
        if left <= 0:
            return False
        executor.spin_once(timeout_sec=left)
    return True
