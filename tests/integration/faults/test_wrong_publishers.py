"""Publishers that can't be understood, beside one that can."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Pose, Twist
from invariants import (
    assert_every_command_belongs_to_a_target,
    connect,
    good_target,
    settled,
    wait_for_counts,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from msg_tools.conversions.pose import pose_from_array


def test_publishers_of_any_quality_of_service_are_served_and_other_commanders_named(
    launch: Callable[..., Any], make_client: Callable[..., Any]
) -> None:
    """One that does its best only too, said once; one of another type is not heard.

    The client is another publisher of commands, which is said once, and in the diagnostics.
    """
    node = launch("ik_node", "-p", "queue_depth:=1000")
    client = make_client()
    connect(client)
    # Within one process the middleware itself refuses a second type on a topic.
    stranger = make_client(targets="elsewhere")
    best_effort = client.node.create_publisher(
        Pose, "target_pose", QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    node.wait_for_text("/target_pose has a publisher with best-effort delivery")
    client.wait_until(best_effort.get_subscription_count, "the node hears it")
    other_type = stranger.node.create_publisher(Twist, "target_pose", QoSProfile(depth=10))
    kept = client.node.create_publisher(
        Pose, "target_pose", QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    client.wait_until(kept.get_subscription_count, "the node knows the publisher")
    client.repeat_until(
        lambda: best_effort.publish(pose_from_array(good_target(100))),
        lambda: client.stamps_of(good_target(100)),
        "an answer",
    )
    client.repeat_until(
        lambda: kept.publish(pose_from_array(good_target(99))),
        lambda: client.stamps_of(good_target(99)),
        "an answer",
    )
    contacts = settled(client)
    for number in range(1, 11):
        best_effort.publish(pose_from_array(good_target(100 + number)))
        other_type.publish(Twist())
        kept.publish(pose_from_array(good_target(number)))
    assert wait_for_counts(client, contacts + 20).accepted == contacts + 20
    targets = [good_target(100 * part + n) for part in (0, 1) for n in range(11)]
    assert_every_command_belongs_to_a_target(client, targets)
    trouble = "others publish /joint_command too: /client"
    client.wait_until(
        lambda: (found := client.status("ik_node")) and found[0].message.startswith(trouble),
        "a warning in the diagnostics",
    )
    status, values = client.status("ik_node")
    assert status.level == DiagnosticStatus.WARN
    assert not [value for value in values.values() if "nan" in value]
    # Two clients, which the node may have found one after the other.
    assert 1 <= node.log.count("others publish") <= 2
    assert node.log.count("best-effort") == 1
    # Once it is gone, nothing is lost any more: the others are received reliably.
    client.node.destroy_publisher(best_effort)
    node.wait_for_text("/target_pose is received reliably again")
    contacts = settled(client)
    client.repeat_until(
        lambda: kept.publish(pose_from_array(good_target(300))),
        lambda: client.stamps_of(good_target(300)),
        "an answer",
    )
    assert wait_for_counts(client, contacts + 1).accepted > contacts
    assert node.log.count("best-effort") == 1
    assert node.is_running
