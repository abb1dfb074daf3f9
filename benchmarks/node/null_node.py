"""A node that publishes the same command for every target: the cost of ROS 2 alone."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from geometry_msgs.msg import Pose
from rclpy.node import Node
from sensor_msgs.msg import JointState

from annik_ros.parameters import ExecutorChoice
from annik_ros.qos import RESULT_DEPTH, reliable
from annik_ros.run_node import make_executor, run_node
from msg_tools.topics import JOINT_COMMAND, TARGET_POSE

NODE_NAME = "null_node"
_JOINTS = 6


@dataclass(frozen=True)
class NullNodeParameters:
    """None that ``--help`` would list."""


class NullNode(Node):  # type: ignore[misc,unused-ignore]
    """Plain rclpy: takes a message, publishes a message.

    Its parameters: ``executor`` and ``queue_depth`` as those of ``ik_node``; ``marked``: whether
    the stamp of a command is the time at which it was made, and its first joint position the x of
    its target.
    """

    def __init__(self) -> None:
        """Subscribe."""
        super().__init__(NODE_NAME)
        self.executor_choice = ExecutorChoice(
            self.declare_parameter("executor", ExecutorChoice.SINGLE_THREADED.value).value
        )
        depth = self.declare_parameter("queue_depth", 1).value
        marked = self.declare_parameter("marked", False).value
        self._command = JointState(
            name=[f"joint_{joint}" for joint in range(1, _JOINTS + 1)], position=[0.0] * _JOINTS
        )
        self._publisher = self.create_publisher(
            JointState, JOINT_COMMAND.name, reliable(RESULT_DEPTH)
        )
        self.create_subscription(
            Pose,
            TARGET_POSE.name,
            self._publish_marked if marked else self._send,
            reliable(depth),
        )

    def _send(self, _: Pose) -> None:
        self._publisher.publish(self._command)

    def _publish_marked(self, target: Pose) -> None:
        self._command.position[0] = target.position.x
        self._command.header.stamp = self.get_clock().now().to_msg()
        self._publisher.publish(self._command)


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(
        NODE_NAME,
        NullNode,
        NullNodeParameters,
        args,
        executor=lambda node: make_executor(node.executor_choice),
    )


if __name__ == "__main__":
    sys.exit(main())
