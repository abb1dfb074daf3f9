"""A node that answers every target with the same joint positions: what ROS 2 alone takes."""

from __future__ import annotations

import sys

from geometry_msgs.msg import Pose
from rclpy.node import Node
from sensor_msgs.msg import JointState

from annik_ros.parameters import ExecutorChoice
from annik_ros.qos import RESULT_DEPTH, reliable
from annik_ros.run_node import make_executor, run_node
from msg_tools.topics import JOINT_COMMAND, TARGET_POSE

NODE_NAME = "null_node"
_JOINTS = 6


class NullNode(Node):
    """Plain rclpy: takes a message, publishes a message.

    Its parameters: ``executor`` and ``queue_depth`` as those of ``ik_node``; ``marked``: whether
    an answer says when it was made, by its stamp, and to what, by the target's x in the place of
    the first joint position.
    """

    def __init__(self) -> None:
        """Subscribe."""
        super().__init__(NODE_NAME)
        self.executor_choice = ExecutorChoice(
            self.declare_parameter("executor", ExecutorChoice.SINGLE_THREADED.value).value
        )
        depth = self.declare_parameter("queue_depth", 1).value
        marked = self.declare_parameter("marked", False).value
        self._answer = JointState(
            name=[f"joint_{joint}" for joint in range(1, _JOINTS + 1)], position=[0.0] * _JOINTS
        )
        self._publisher = self.create_publisher(
            JointState, JOINT_COMMAND.name, reliable(RESULT_DEPTH)
        )
        self.create_subscription(
            Pose,
            TARGET_POSE.name,
            self._mark_and_answer if marked else self._send,
            reliable(depth),
        )

    def _send(self, _: Pose) -> None:
        self._publisher.publish(self._answer)

    def _mark_and_answer(self, target: Pose) -> None:
        self._answer.position[0] = target.position.x
        self._answer.header.stamp = self.get_clock().now().to_msg()
        self._publisher.publish(self._answer)


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(
        NODE_NAME, NullNode, args, executor=lambda node: make_executor(node.executor_choice)
    )


if __name__ == "__main__":
    sys.exit(main())
