"""The node that records the topics of annik, or others, into a bag."""

import sys
import time
from collections.abc import Sequence
from datetime import datetime
from importlib import import_module
from typing import Final

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.validate_topic_name import validate_topic_name
from rosbags import interfaces

from annik_core.errors import AnnikError, NotWritable, one_line
from annik_core.files import expanded
from annik_ros.bag_recorder.parameters import BagRecorderParameters
from annik_ros.declare_parameters import declare_parameters
from annik_ros.run_node import run_node
from msg_tools.bags.metadata import is_known_type
from msg_tools.bags.writer import FLUSH_INTERVAL, BagWriter
from msg_tools.topics import ROBOT_DESCRIPTION, TOPICS

NODE_NAME: Final = "bag_recorder"

#: Depth of the subscriptions, for a slow disk.
QUEUE_DEPTH: Final = 1000

_TYPES: Final = {topic.name: topic.type for topic in TOPICS}


class TypeNotRecordable(AnnikError):
    """Messages of a type can't be received, or their definition is unknown."""

    def __init__(self, message_type: str, reason: str) -> None:
        self.message_type = message_type
        super().__init__(f"{message_type} {reason}")


class BagRecorder(Node):
    """Subscribes to topics and writes their messages undecoded, with send and receive times."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        options = declare_parameters(self, BagRecorderParameters)
        self.finished: Future[int] = Future()
        self._subscriptions_by_topic: dict[str, Subscription] = {}
        self._types: dict[str, str] = {}
        self._incompatible: set[str] = set()
        self._last_log_time = 0
        self._ready_at: float | None = None
        self._warned_of_waiting = False
        self._waiting = {self._resolved(name): _TYPES.get(name) for name in options.topics}
        self._duration = options.duration
        default_output = f"annik_bag_{datetime.now():%Y-%m-%d_%H-%M-%S}"
        self._writer = BagWriter(expanded(options.output or default_output))
        # A steady clock: simulated or changed time must not stop the flushing.
        self._timer = self.create_timer(
            FLUSH_INTERVAL, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._subscribe_to_known_types()

    def close_bag(self) -> str:
        """Close the bag; returns one line on what was recorded, or raises NotWritable."""
        self._writer.close()
        return f"recorded {self._writer.message_count} messages to {self._writer.directory}"

    def _resolved(self, name: str) -> str:
        # Resolving an invalid name fails without naming it.
        validate_topic_name(name)
        return self.resolve_topic_name(name)

    def _on_timer(self) -> None:
        if self.finished.done():
            return
        if self._waiting:
            self._learn_types()
            self._subscribe_to_known_types()
        for topic in tuple(self._incompatible):
            self._incompatible.discard(topic)
            self._subscribe(topic, self._types[topic])
        try:
            self._writer.flush()
        except NotWritable as error:
            self._give_up(error)
            return
        if (
            self._ready_at is not None
            and 0.0 < self._duration <= time.monotonic() - self._ready_at
        ):
            self.finished.set_result(0)

    def _learn_types(self) -> None:
        in_graph = dict(self.get_topic_names_and_types())
        for topic in self._waiting:
            if self._waiting[topic] is None and in_graph.get(topic):
                self._waiting[topic] = in_graph[topic][0]

    def _subscribe_to_known_types(self) -> None:
        known = {topic: name for topic, name in self._waiting.items() if name is not None}
        for topic, message_type in known.items():
            del self._waiting[topic]
            try:
                self._subscribe(topic, message_type)
            except TypeNotRecordable as error:
                self.get_logger().error(f"{topic} is not recorded: {error}")
        if self._waiting and not self._warned_of_waiting:
            self._warned_of_waiting = True
            self.get_logger().info(
                f"waiting for a publisher of {', '.join(self._waiting)} to learn its type"
            )
        if not self._waiting and self._ready_at is None:
            self._ready_at = time.monotonic()
            self.get_logger().info(
                f"recording {len(self._subscriptions_by_topic)} topics to {self._writer.directory}"
            )

    def _subscribe(self, topic: str, message_type: str) -> None:
        """Subscribe with a QoS that the present publishers can serve; replaces an earlier one."""
        message_class = _message_class(message_type)
        earlier = self._subscriptions_by_topic.pop(topic, None)
        if earlier is not None:
            self.destroy_subscription(earlier)
        self._types[topic] = message_type
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda _: self._incompatible.add(topic)
        )
        self._subscriptions_by_topic[topic] = self.create_subscription(
            message_class,
            topic,
            # With a second argument rclpy passes the times of the message too.
            lambda message, info: self._on_message(topic, message, info),
            _subscription_qos(
                self.get_publishers_info_by_topic(topic),
                latched=topic == self._resolved(ROBOT_DESCRIPTION.name),
            ),
            event_callbacks=events,
            raw=True,
        )

    def _on_message(self, topic: str, message: bytes, info: dict[str, int]) -> None:
        if self.finished.done():
            return
        # Never decreasing, even if the clock is set: readers of unfinished bags need the order.
        self._last_log_time = max(time.time_ns(), self._last_log_time)
        try:
            if topic not in self._writer:
                publishers = self.get_publishers_info_by_topic(topic)
                offered = [_qos(publisher.qos_profile) for publisher in publishers]
                self._writer.add_topic(topic, self._types[topic], offered)
            self._writer.write(
                topic,
                bytes(message),
                self._last_log_time,
                info.get("source_timestamp") or self._last_log_time,
            )
        except NotWritable as error:
            self._give_up(error)

    def _give_up(self, error: NotWritable) -> None:
        self.get_logger().fatal(f"recording stopped: {error}")
        self.finished.set_result(1)


def _message_class(message_type: str) -> type[object]:
    if not is_known_type(message_type):
        raise TypeNotRecordable(
            message_type, "does not come with ROS 2 Jazzy; record it with 'ros2 bag record'"
        )
    package, folder, name = message_type.split("/")
    try:
        message_class: type[object] = getattr(import_module(f"{package}.{folder}"), name)
    # A machine may lack packages that come with Jazzy.
    except (ImportError, AttributeError) as error:
        raise TypeNotRecordable(
            message_type, f"is not installed here: {one_line(error)}"
        ) from error
    return message_class


def _subscription_qos(publishers: Sequence[TopicEndpointInfo], *, latched: bool) -> QoSProfile:
    """The strictest quality of service that all publishers can serve; ``latched`` if unknown."""
    profiles = [publisher.qos_profile for publisher in publishers]
    best_effort = any(x.reliability == ReliabilityPolicy.BEST_EFFORT for x in profiles)
    if profiles:
        latched = all(x.durability == DurabilityPolicy.TRANSIENT_LOCAL for x in profiles)
    return QoSProfile(
        depth=QUEUE_DEPTH,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _qos(profile: QoSProfile) -> interfaces.Qos:
    """The quality of service of a publisher as a bag stores it."""
    return interfaces.Qos(
        history=interfaces.QosHistory[profile.history.name],
        depth=profile.depth,
        reliability=interfaces.QosReliability[profile.reliability.name],
        durability=interfaces.QosDurability[profile.durability.name],
        deadline=_qos_time(profile.deadline),
        lifespan=_qos_time(profile.lifespan),
        liveliness=interfaces.QosLiveliness[profile.liveliness.name],
        liveliness_lease_duration=_qos_time(profile.liveliness_lease_duration),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
    )


def _qos_time(duration: Duration) -> interfaces.QosTime:
    return interfaces.QosTime(*divmod(duration.nanoseconds, 1_000_000_000))


def main(args: list[str] | None = None) -> int:
    """Record until interrupted, for the given time, or until the bag can't be written."""
    # Not EventsExecutor: on Jazzy it can't pass the times of a message.
    return run_node(
        NODE_NAME,
        BagRecorder,
        BagRecorderParameters,
        args,
        finished=lambda recorder: recorder.finished,
        finish=BagRecorder.close_bag,
    )


if __name__ == "__main__":
    sys.exit(main())
