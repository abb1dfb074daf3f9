"""The node that publishes a path of targets and ends when they are delivered."""

import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from itertools import chain, repeat
from typing import Any

from geometry_msgs.msg import Pose, PoseStamped, Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.subscription import Subscription
from rclpy.task import Future
from rclpy.timer import Timer

from annik_core.errors import AnnikError
from annik_core.pose import FloatArray
from annik_ros.declare_parameters import declare_parameters
from annik_ros.qos import RESULT_DEPTH, reliable
from annik_ros.run_node import NotInTime, run_node
from annik_ros.target_publisher.parameters import ExpectedResults, TargetPublisherParameters
from msg_tools.conversions.pose import pose_from_array, pose_stamped_from_array
from msg_tools.topics import (
    ACCEPTED_TARGET,
    POSITION_ERROR,
    TARGET_POSE,
    TARGET_POSE_STAMPED,
    Topic,
)

NODE_NAME = "target_publisher"

#: Period of checks for subscribers and for delivery [s].
POLL_PERIOD = 0.02
#: Time without a new subscriber before the first target [s]. Discovery finds subscribers one by
#: one, and each is known here before this publisher is known there: targets published in between
#: arrive all at once, and a subscriber of depth 1 keeps only the newest.
SETTLING_TIME = 4.0
#: Longest wait for the confirmation of the last targets [s].
DELIVERY_TIMEOUT = 10.0
#: Time without a further result, after which no more are expected [s].
RESULT_TIMEOUT = 5.0

_RESULTS: dict[ExpectedResults, tuple[tuple[Topic, type], ...]] = {
    ExpectedResults.NONE: (),
    ExpectedResults.ACCEPTED: ((ACCEPTED_TARGET, PoseStamped),),
    ExpectedResults.ACHIEVED: ((ACCEPTED_TARGET, PoseStamped), (POSITION_ERROR, Vector3Stamped)),
}


class ResultsMissing(AnnikError):
    """Not every target had its results."""

    def __init__(self, published: int, results: dict[str, int]) -> None:
        self.published = published
        self.results = results
        counts = ", ".join(f"{count} on {topic}" for topic, count in results.items())
        super().__init__(
            f"of {published} targets only these results came: {counts}; ik_node warns of what it "
            "refuses, and counts it in /diagnostics"
        )


class TargetPublisher(Node):
    """Waits for the other nodes, publishes each target once, waits for delivery and results."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.finished = Future()
        self._options = declare_parameters(self, TargetPublisherParameters)
        path = self._options.poses()
        loops = self._options.loops
        self._targets: Iterator[FloatArray] = chain.from_iterable(
            repeat(path) if loops == 0 else repeat(path, loops)
        )
        self._published = 0
        self._others: tuple[int, ...] = ()
        self._settled_at = 0.0
        self._results: Counter[Topic] = Counter()
        self._last_result = 0.0
        self._result_subscriptions: dict[Topic, Subscription] = {
            topic: self.create_subscription(
                message_type, topic.name, partial(self._on_result, topic), reliable(RESULT_DEPTH)
            )
            for topic, message_type in _RESULTS[self._options.expected_results]
        }
        message_type, topic = (
            (PoseStamped, TARGET_POSE_STAMPED) if self._options.stamped else (Pose, TARGET_POSE)
        )
        self._publisher: Publisher = self.create_publisher(
            message_type, topic.name, reliable(RESULT_DEPTH)
        )
        self._deadline = time.monotonic() + self._options.wait_timeout
        self._timer = self._every(POLL_PERIOD, self._wait_for_others)
        self.get_logger().info(
            f"path {self._options.path.path.value} on {self._publisher.topic_name}: waiting for "
            f"{self._options.wait_for_subscribers} subscriber(s)"
        )

    def _every(self, period: float, callback: Callable[[], None]) -> Timer:
        return self.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _wait_for_others(self) -> None:
        found = self._publisher.get_subscription_count()
        wanted = self._options.wait_for_subscribers
        publishers = self._publishers_of_results()
        others = (found, *publishers.values())
        now = time.monotonic()
        if others != self._others:
            self._others = others
            self._settled_at = now + SETTLING_TIME
        # Two publishers of results are two robots, whose results can't be told apart.
        if found >= wanted and all(count == 1 for count in publishers.values()):
            if not (wanted or publishers) or now >= self._settled_at:
                self._begin()
        elif now > self._deadline:
            raise self._others_missing()

    def _publishers_of_results(self) -> dict[str, int]:
        return {
            subscription.topic_name: subscription.get_publisher_count()
            for subscription in self._result_subscriptions.values()
        }

    def _others_missing(self) -> NotInTime:
        found = self._publisher.get_subscription_count()
        wanted = self._options.wait_for_subscribers
        counts = [f"{found} of {wanted} subscribers on {self._publisher.topic_name}"]
        counts += [
            f"{count} of 1 publishers on {topic}"
            for topic, count in self._publishers_of_results().items()
        ]
        return NotInTime(
            ", ".join(counts),
            self._options.wait_timeout,
            "is ik_node running, once, in the same namespace and ROS_DOMAIN_ID?",
        )

    def _begin(self) -> None:
        self.destroy_timer(self._timer)
        self._results.clear()
        self._timer = self._every(1.0 / self._options.rate, self._publish_next)

    def _publish_next(self) -> None:
        target = next(self._targets, None)
        if target is None:
            self.destroy_timer(self._timer)
            self._deadline = time.monotonic() + DELIVERY_TIMEOUT
            self._timer = self._every(POLL_PERIOD, self._wait_for_delivery)
            return
        if self._options.stamped:
            stamp = self.get_clock().now().to_msg()
            message = pose_stamped_from_array(target, stamp, self._options.frame_id)
        else:
            message = pose_from_array(target)
        self._publisher.publish(message)
        self._published += 1

    def _wait_for_delivery(self) -> None:
        # In short steps, so that signals are handled between them.
        if self._publisher.wait_for_all_acked(Duration(seconds=POLL_PERIOD)):
            self.destroy_timer(self._timer)
            self.get_logger().info(f"published {self._published} targets")
            self._last_result = time.monotonic()
            self._timer = self._every(POLL_PERIOD, self._wait_for_results)
        elif time.monotonic() > self._deadline:
            raise NotInTime(
                f"a subscriber on {self._publisher.topic_name} did not confirm the last targets",
                DELIVERY_TIMEOUT,
                "is it still running?",
            )

    def _wait_for_results(self) -> None:
        # The second robot may have been discovered after the first target.
        if any(count > 1 for count in self._publishers_of_results().values()):
            raise self._others_missing()
        results = {
            subscription.topic_name: self._results[topic]
            for topic, subscription in self._result_subscriptions.items()
        }
        if all(count >= self._published for count in results.values()):
            self.destroy_timer(self._timer)
            if self._options.exit_when_done:
                self.finished.set_result(None)
        elif time.monotonic() > self._last_result + RESULT_TIMEOUT:
            raise ResultsMissing(self._published, results)

    def _on_result(self, topic: Topic, _: Any) -> None:
        self._results[topic] += 1
        self._last_result = time.monotonic()


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(
        NODE_NAME,
        TargetPublisher,
        TargetPublisherParameters,
        args,
        finished=lambda node: node.finished,
    )


if __name__ == "__main__":
    sys.exit(main())
