# ruff: noqa: E402 - without rclpy there is nothing to import
"""A client of the nodes, for the tests over real DDS."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from support.processes import PATIENCE

rclpy = pytest.importorskip("rclpy")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose, PoseStamped, Vector3Stamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from annik_core.pose import FloatArray
from msg_tools.conversions.pose import pose_from_array, pose_stamped_from_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds, stamp_to_nanoseconds

#: Beginnings of keys in diagnostics that are listed once they occur, and how they are documented.
_OCCASIONAL = {
    "refused: ": "refused: REASON",
    "joint states unusable: ": "joint states unusable: FAULT",
}


def reported_keys(values: Mapping[str, str]) -> set[str]:
    """The keys of a diagnostic report, as they are documented."""
    return {
        next((named for start, named in _OCCASIONAL.items() if key.startswith(start)), key)
        for key in values
    }


class Client:
    """Sends targets as a user would, and keeps what the nodes publish."""

    def __init__(self, domain: int, namespace: str = "", targets: str = "target_pose") -> None:
        """Join the domain.

        Args:
            domain: ROS domain.
            namespace: the namespace that the nodes are in.
            targets: the topic to send plain targets on.
        """
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node("client", context=self.context, namespace=namespace)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        many = QoSProfile(depth=1000)
        self.target = self.node.create_publisher(Pose, targets, many)
        self.stamped_target = self.node.create_publisher(PoseStamped, "target_pose_stamped", many)
        self.command = self.node.create_publisher(JointState, "joint_command", many)
        self.accepted_target = self.node.create_publisher(PoseStamped, "accepted_target", many)
        self.received: dict[str, list[Any]] = {}
        self._services: dict[str, Any] = {}
        for topic, message_type in (
            ("accepted_target", PoseStamped),
            ("joint_command", JointState),
            ("joint_states", JointState),
            ("achieved_pose", PoseStamped),
            ("tracking_error/position", Vector3Stamped),
            ("tracking_error/orientation", Vector3Stamped),
            ("/diagnostics", DiagnosticArray),
        ):
            self.listen(topic, message_type)

    def listen(self, topic: str, message_type: type) -> None:
        """Keep what is published on one more topic."""
        messages = self.received.setdefault(topic, [])
        self.node.create_subscription(message_type, topic, messages.append, QoSProfile(depth=1000))

    def topics_of(self, node: str) -> dict[str, str]:
        """The topics that a node publishes or subscribes to, with their types, discovered so far.

        Its topics may be discovered before its name, which is waited for.
        """
        self.wait_until(lambda: node in self.node.get_node_names(), f"the name of {node}")
        used = (
            *self.node.get_publisher_names_and_types_by_node(node, "/"),
            *self.node.get_subscriber_names_and_types_by_node(node, "/"),
        )
        return {name: types[0] for name, types in used}

    def wait_until(
        self, condition: Callable[[], object], what: str, patience: float = PATIENCE
    ) -> None:
        """Take messages until the condition holds; fail if it takes too long."""
        deadline = time.monotonic() + patience
        while not condition():
            if time.monotonic() > deadline:
                pytest.fail(f"waited {patience:g} s in vain: {what}")
            self.executor.spin_once(timeout_sec=0.05)

    def repeat_until(
        self,
        action: Callable[[], object],
        condition: Callable[[], object],
        what: str,
        pause: float = 0.3,
    ) -> None:
        """Do something again and again, taking messages in between, until a condition holds.

        Args:
            action: is done first, and once more after each pause.
            condition: ends it, at once.
            what: names what is waited for if it takes too long.
            pause: time between two actions [s].
        """
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                pytest.fail(f"waited {PATIENCE:g} s in vain: {what}")
            action()
            next_action = time.monotonic() + pause
            while time.monotonic() < next_action and not condition():
                self.executor.spin_once(timeout_sec=0.05)

    def take_the_rest(self) -> None:
        """Take messages until none came for a while, those aside that come at a rate."""
        at_a_rate = ("/diagnostics", "joint_states")

        def count() -> int:
            return sum(
                len(kept) for topic, kept in self.received.items() if topic not in at_a_rate
            )

        before = -1
        while before != count():
            before = count()
            self.take_messages(0.3)

    def take_messages(self, duration: float) -> None:
        """Take messages for a while [s]."""
        deadline = time.monotonic() + duration
        while time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)

    def send(self, pose: FloatArray) -> None:
        """Send a target; the message carries the seven numbers as they are."""
        self.wait_until(self.target.get_subscription_count, "a subscriber of the targets")
        self.target.publish(pose_from_array(pose))

    def send_stamped(self, pose: FloatArray, frame_id: str) -> None:
        """Send a stamped target in a frame."""
        self.wait_until(self.stamped_target.get_subscription_count, "a subscriber of the targets")
        now = self.node.get_clock().now().nanoseconds
        self.stamped_target.publish(self.pose_stamped(pose, now, frame_id))

    @staticmethod
    def pose_stamped(pose: FloatArray, stamp: int, frame_id: str) -> PoseStamped:
        """The message of a pose at a time [ns]."""
        return pose_stamped_from_array(pose, stamp_from_nanoseconds(stamp), frame_id)

    def stamps(self, topic: str) -> list[int]:
        """Stamps of what was received on a topic, in the order of arrival [ns]."""
        return [stamp_to_nanoseconds(message.header.stamp) for message in self.received[topic]]

    def stamps_of(self, pose: FloatArray) -> list[int]:
        """Stamps under which a target was accepted [ns]; targets are told apart by their x."""
        return [
            stamp_to_nanoseconds(message.header.stamp)
            for message in self.received["accepted_target"]
            if message.pose.position.x == float(pose[0])
        ]

    def connect(self, pose: FloatArray, result: str = "joint_command") -> None:
        """Send one target again and again until its result arrives: everybody has met.

        A publisher knows its subscriber a moment before or after the subscriber knows it, so no
        count of matches says that the whole chain is there. No result of these targets is still on
        its way afterwards.
        """
        self.repeat_until(
            lambda: self.send(pose),
            lambda: self._has_result(pose, result),
            f"{result} of the first target",
        )
        # Told from the others by its last bit, and answered after them: topics keep their order.
        last = pose.copy()
        last[0] = np.nextafter(pose[0], np.inf)
        self.send(last)
        topics = ("joint_command", result)
        self.wait_for_results(last, [topic for topic in topics if self._has_result(pose, topic)])

    def wait_for_results(self, pose: FloatArray, topics: Sequence[str]) -> None:
        """Wait for what came of a target on every one of these topics.

        The topics are independent of each other: what was published last may arrive first.
        """
        for topic in topics:
            self.wait_until(
                lambda topic=topic: self._has_result(pose, topic), f"{topic} of the target"
            )

    def _has_result(self, pose: FloatArray, result: str) -> bool:
        return bool(set(self.stamps_of(pose)) & set(self.stamps(result)))

    def status(self, node: str) -> tuple[DiagnosticStatus, dict[str, str]] | None:
        """What a node last said of itself on /diagnostics, and its values."""
        for message in reversed(self.received["/diagnostics"]):
            for status in message.status:
                if status.name == node:
                    return status, {value.key: value.value for value in status.values}
        return None

    def wait_for_status(
        self, node: str, condition: Callable[[dict[str, str]], bool], what: str
    ) -> tuple[DiagnosticStatus, dict[str, str]]:
        """The first report of a node, from now on, whose values meet the condition."""
        self.received["/diagnostics"].clear()
        self.wait_until(lambda: self._meets(node, condition), f"diagnostics with {what}")
        found = self.status(node)
        assert found is not None
        return found

    def _meets(self, node: str, condition: Callable[[dict[str, str]], bool]) -> bool:
        found = self.status(node)
        return found is not None and condition(found[1])

    def call(self, service: str) -> Trigger.Response:
        """The response of a trigger service."""
        return self.request(Trigger, service, Trigger.Request())

    def set_parameter(self, node: str, name: str, value: object) -> SetParametersResult:
        """What a node answers to a new value for one of its parameters."""
        request = SetParameters.Request()
        request.parameters = [Parameter(name, value=value).to_parameter_msg()]
        return self.request(SetParameters, f"{node}/set_parameters", request).results[0]

    def set_parameters_atomically(
        self, node: str, values: Mapping[str, object]
    ) -> SetParametersResult:
        """What a node answers to new values for several parameters, all or none."""
        request = SetParametersAtomically.Request()
        request.parameters = [
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        service = f"{node}/set_parameters_atomically"
        return self.request(SetParametersAtomically, service, request).result

    def change_state(self, node: str, transition: int | str) -> bool:
        """Whether a transition of the life cycle, by its number or its label, succeeded."""
        by = {"label" if isinstance(transition, str) else "id": transition}
        request = ChangeState.Request(transition=Transition(**by))
        return bool(self.request(ChangeState, f"{node}/change_state", request).success)

    def state(self, node: str) -> str:
        """The label of a node's state in its life cycle."""
        response = self.request(GetState, f"{node}/get_state", GetState.Request())
        return str(response.current_state.label)

    def request(self, service_type: type, service: str, request: Any) -> Any:
        """The response of any service."""
        # To find a service takes longer than to call it.
        if service not in self._services:
            self._services[service] = self.node.create_client(service_type, service)
        client = self._services[service]
        self.wait_until(client.service_is_ready, f"service {service}")
        futures: list[Any] = []
        # Of a service that has not discovered this client yet, a response is lost. To ask for the
        # state again does no harm.
        self.repeat_until(
            lambda: futures.append(client.call_async(request)),
            lambda: any(future.done() for future in futures),
            f"the response of {service}",
            pause=10.0 if service_type is GetState else PATIENCE,
        )
        return next(future for future in futures if future.done()).result()

    def close(self) -> None:
        """Leave the domain."""
        self.executor.shutdown(timeout_sec=0.0)
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def make_client(domain: int) -> Iterator[Callable[..., Client]]:
    """Make a client: ``make_client(namespace=..., targets=...)``."""
    clients: list[Client] = []

    def make(**arguments: str) -> Client:
        clients.append(Client(domain, **arguments))
        return clients[-1]

    yield make
    for client in clients:
        client.close()


@pytest.fixture
def client(make_client: Callable[..., Client]) -> Client:
    """A client in the root namespace."""
    return make_client()
