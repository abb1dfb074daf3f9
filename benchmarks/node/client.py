"""A lean client: sends targets as bytes and notes when commands arrive."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import rclpy
from geometry_msgs.msg import Pose, PoseStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from annik_core.errors import AnnikError
from annik_ros.parameters import ExecutorChoice
from annik_ros.qos import reliable
from annik_ros.run_node import make_executor
from msg_tools.topics import ACCEPTED_TARGET, JOINT_COMMAND, TARGET_POSE

#: Longest wait for a command [s]; then the target counts as one without a command.
COMMAND_TIMEOUT = 1.0
#: Depth of the queues: no command may be lost on the way to the client.
_DEPTH = 10_000
#: Longest wait for the first command of a node [s].
CONNECT_TIMEOUT = 60.0
#: Period of the targets until the first command [s].
_CONNECT_PERIOD = 0.05
#: Time without a command after which none is on its way any more [s].
_QUIET = 0.25


class NoCommand(AnnikError):
    """No command of a node arrived."""

    def __init__(self, namespace: str, timeout: float) -> None:
        self.namespace = namespace
        super().__init__(f"no command in {namespace} within {timeout:g} s; its log says why")


class Link:
    """The client's publisher and subscriptions for one node.

    Attributes:
        namespace: the node's.
        received: number of commands that arrived.
        arrival: time of the last one, by :func:`time.perf_counter` [s].
        commands: their bytes, while they are kept.
        accepted_targets: likewise those of ``accepted_target``.
        keeps: whether they are kept.
    """

    def __init__(self, node: Node, namespace: str) -> None:
        """Publish its targets and subscribe to its commands."""
        self.namespace = namespace
        self.received = 0
        self.arrival = 0.0
        self.keeps = False
        self.commands: list[bytes] = []
        self.accepted_targets: list[bytes] = []
        self._node = node
        self._publisher = node.create_publisher(
            Pose, f"{namespace}/{TARGET_POSE.name}", reliable(_DEPTH)
        )
        self._subscriptions = [
            node.create_subscription(
                JointState,
                f"{namespace}/{JOINT_COMMAND.name}",
                self._on_command,
                reliable(_DEPTH),
                raw=True,
            )
        ]

    def listen_to_accepted_targets(self) -> None:
        """Subscribe to ``accepted_target`` too."""
        self._subscriptions.append(
            self._node.create_subscription(
                PoseStamped,
                f"{self.namespace}/{ACCEPTED_TARGET.name}",
                self._on_accepted_target,
                reliable(_DEPTH),
                raw=True,
            )
        )

    def send(self, target: bytes) -> None:
        """Publish a target."""
        self._publisher.publish(target)

    def destroy(self) -> None:
        """Remove publisher and subscriptions from the client."""
        self._node.destroy_publisher(self._publisher)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _on_command(self, data: bytes) -> None:
        self.arrival = time.perf_counter()
        self.received += 1
        if self.keeps:
            self.commands.append(data)

    def _on_accepted_target(self, data: bytes) -> None:
        if self.keeps:
            self.accepted_targets.append(data)


class Client:
    """A node of its own with the events executor."""

    def __init__(self) -> None:
        """Join the domain that the environment names."""
        rclpy.init(args=[])
        self._node = Node("node_bench")
        self._executor = make_executor(ExecutorChoice.EVENTS)
        self._executor.add_node(self._node)
        self._links: list[Link] = []

    @property
    def middleware(self) -> str:
        """The name of ROS 2's middleware."""
        return str(rclpy.get_rmw_implementation_identifier())

    def link(self, namespace: str) -> Link:
        """Connect to the node in a namespace, which may not be there yet."""
        return Link(self._node, namespace)

    def spin_once(self, timeout: float) -> None:
        """Run the callbacks of what has arrived, or wait for at most ``timeout`` [s]."""
        self._executor.spin_once(timeout_sec=timeout)

    def spin_for(self, duration: float) -> None:
        """Run the callbacks of what arrives for a while [s]."""
        self.spin_until(lambda: False, duration)

    def spin_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Whether the condition comes true within ``timeout`` [s]."""
        deadline = time.perf_counter() + timeout
        while not condition():
            left = deadline - time.perf_counter()
            if left <= 0:
                return False
            self.spin_once(min(left, 0.05))
        return True

    def round_trip(
        self, link: Link, target: bytes, timeout: float = COMMAND_TIMEOUT
    ) -> float | None:
        """The round trip of one target [s], or None if no command arrives in ``timeout`` [s]."""
        before = link.received
        begin = time.perf_counter()
        link.send(target)
        while link.received == before:
            left = begin + timeout - time.perf_counter()
            if left <= 0:
                return None
            self.spin_once(left)
        return link.arrival - begin

    def connect(self, link: Link, target: bytes) -> None:
        """Send a target until a command arrives, and wait for further ones.

        Raises:
            NoCommand: if none does.
        """
        self.wait_for_first(link, target, _CONNECT_PERIOD, CONNECT_TIMEOUT)
        self.quiet(link)

    def wait_for_first(self, link: Link, target: bytes, period: float, timeout: float) -> None:
        """Send a target every ``period`` [s] until a command arrives: discovery is over.

        Raises:
            NoCommand: if none does within ``timeout`` [s].
        """
        deadline = time.perf_counter() + timeout
        while self.round_trip(link, target, period) is None:
            if time.perf_counter() > deadline:
                raise NoCommand(link.namespace, timeout)

    def quiet(self, link: Link) -> None:
        """Wait until no command for an earlier target is on its way any more."""
        before = -1
        while before != link.received:
            before = link.received
            self.spin_for(_QUIET)

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown(timeout_sec=0.0)
        self._node.destroy_node()
        rclpy.try_shutdown()


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Switch Python's garbage collection off."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
