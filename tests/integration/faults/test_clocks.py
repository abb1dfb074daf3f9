"""Clocks that stand still, jump, go back, or never come."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from invariants import (
    assert_all_numbers_finite,
    assert_every_command_belongs_to_a_target,
    connect,
    good_target,
)
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

SECOND = 10**9


def test_simulated_time_may_do_what_it_likes(launch: Callable[..., Any], client: Any) -> None:
    """No two commands share a stamp, stale targets are told by that clock, reports go on."""
    node = launch(
        "ik_node",
        *("-p", "use_sim_time:=true", "-p", "queue_depth:=100", "-p", "max_target_age:=1.0"),
    )
    clock = client.node.create_publisher(Clock, "/clock", QoSProfile(depth=10))
    received = connect(client)
    client.wait_until(clock.get_subscription_count, "the node listens to the clock")
    number = 0

    def show(seconds: int, nanosec: int = 0) -> None:
        message = Clock()
        message.clock.sec, message.clock.nanosec = seconds, nanosec
        clock.publish(message)
        # Two topics are independent of each other: only time makes an order.
        client.take_messages(0.15)

    def send_at(seconds: float) -> None:
        nonlocal received, number
        received += 1
        number += 1
        stamp = int(seconds * SECOND)
        client.stamped_target.publish(client.pose_stamped(good_target(number), stamp, ""))

    def answered_at(seconds: float) -> int:
        send_at(seconds)
        client.wait_for_results(good_target(number), ["joint_command"])
        return client.stamps_of(good_target(number))[0]

    show(1000)
    assert answered_at(1000.5) == 1000 * SECOND
    # It stands still: the stamps may not.
    assert answered_at(999.5) == 1000 * SECOND + 1
    send_at(998.5)
    send_at(1001.5)
    stale = 2
    # A log that is played from its beginning again.
    show(10)
    assert answered_at(10.0) == 1000 * SECOND + 2
    send_at(1000.0)
    stale += 1
    show(5000)
    assert answered_at(5000.0) == 5000 * SECOND
    stamps = client.stamps("joint_command")
    assert stamps == sorted(set(stamps))
    targets = [good_target(index) for index in range(number + 1)]
    assert_every_command_belongs_to_a_target(client, targets)
    # The end of time, a time that no message of ours could hold, and one before all times.
    for seconds, nanosec in ((2**31 - 1, 999_999_999), (2**31 - 1, 2**32 - 1), (-5, 0)):
        show(seconds, nanosec)
        number += 1
        received += 1
        client.send(good_target(number))
        client.wait_for_results(good_target(number), ["joint_command"])
    show(6000)
    assert answered_at(6000.0) == 6000 * SECOND
    assert_all_numbers_finite(client)
    client.received["/diagnostics"].clear()
    client.wait_until(lambda: len(client.received["/diagnostics"]) >= 2, "reports")
    found = client.status("ik_node")
    assert found is not None
    assert int(found[1]["targets received"]) == received
    # rclpy's own clock knows no negative time, and says so by an exception.
    assert int(found[1]["callback errors"]) == 1
    assert int(found[1]["refused: stale target"]) == stale
    assert node.is_running
    assert client.state("ik_node") == "active"
    # Back to the clock on the wall, and to the other again, between two targets.
    for simulated, seconds in ((False, None), (True, 6000), (False, None)):
        assert client.set_parameter("ik_node", "use_sim_time", simulated).successful
        number += 1
        now = client.node.get_clock().now().nanoseconds
        stamp = now if seconds is None else seconds * SECOND
        client.stamped_target.publish(client.pose_stamped(good_target(number), stamp, ""))
        client.wait_for_results(good_target(number), ["joint_command"])
