"""Publishers that can't be understood, beside one that can."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import Pose, Twist
from invariants import (
    assert_every_command_belongs_to_a_target,
    connect,
    good_target,
    wait_for_counts,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from msg_tools.conversions.pose import pose_from_array


def test_the_wrong_quality_of_service_is_named_and_the_right_one_served(
    launch: Callable[..., Any], make_client: Callable[..., Any]
) -> None:
    """A publisher that does its best only, and one of another type, are not heard; others are."""
    node = launch("ik_node", "-p", "queue_depth:=1000")
    client = make_client()
    contacts = connect(client)
    # Within one process the middleware itself refuses a second type on a topic.
    stranger = make_client(targets="elsewhere")
    best_effort = client.node.create_publisher(
        Pose, "target_pose", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    node.wait_for_text("incompatible QoS")
    other_type = stranger.node.create_publisher(Twist, "target_pose", QoSProfile(depth=10))
    kept = client.node.create_publisher(
        Pose, "target_pose", QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    client.wait_until(kept.get_subscription_count, "the node knows the publisher")
    for number in range(1, 11):
        best_effort.publish(pose_from_array(good_target(100 + number)))
        other_type.publish(Twist())
        kept.publish(pose_from_array(good_target(number)))
    client.wait_until(lambda: client.stamps_of(good_target(10)), "an answer")
    assert wait_for_counts(client, contacts + 10).accepted == contacts + 10
    assert_every_command_belongs_to_a_target(client, [good_target(n) for n in range(11)])
    assert node.is_running
