"""Topics, services and diagnostics of the nodes are those that the documentation names."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from support.client import reported_keys
from support.processes import PATIENCE

from annik_core.pose import pose_from_roll_pitch_yaw
from annik_core.safety import IkStatus
from annik_ros.ik_node.compute_ik import service_type
from annik_ros.ik_node.parameters import COMPUTE_IK
from docs.diagnostic_values import DIAGNOSTIC_VALUES
from docs.refusals import REFUSALS
from docs.services import SERVICES
from msg_tools.conversions.stamp import stamp_from_nanoseconds
from msg_tools.topics import TOPICS

TARGET = pose_from_roll_pitch_yaw([0.3001, 0.4, 0.6], [0.5, 0.4, 0.3])
UNREACHABLE = pose_from_roll_pitch_yaw([2.0, 0.4, 0.6], [0.5, 0.4, 0.3])


def test_every_refusal_has_a_meaning() -> None:
    """Its value is the key in diagnostics, its meaning the line in the documentation."""
    assert list(REFUSALS) == [status for status in IkStatus if status is not IkStatus.SUCCESS]


def test_both_nodes_report_what_is_documented(launch: Callable[..., Any], client: Any) -> None:
    """All of it, and nothing else; a refusal of either shows its reason."""
    launch("ik_node", "-p", "expected_rate:=100.0", "-p", "queue_depth:=100")
    launch("fake_robot")
    client.connect(TARGET, "tracking_error/position")
    client.send(UNREACHABLE)
    unusable = client.received["joint_command"][-1]
    unusable.position[0] = float("nan")
    unusable.header.stamp = stamp_from_nanoseconds(1)
    client.command.publish(unusable)
    # Without a position for each name.
    states = client.node.create_publisher(JointState, "joint_states", QoSProfile(depth=10))
    fault = "joint states unusable: not one position per name"

    def fault_is_counted() -> bool:
        reported = client.status("ik_node")
        return reported is not None and fault in reported[1]

    # What is published before the node has discovered the publisher is lost.
    client.repeat_until(
        lambda: states.publish(JointState(name=unusable.name, position=[0.0])),
        fault_is_counted,
        "ik_node counts what it can't use",
    )
    for node, expected in (
        ("ik_node", {"refused: outside workspace", fault}),
        ("fake_robot", {"refused: not finite"}),
    ):
        _, values = client.wait_for_status(
            node, lambda values, expected=expected: expected <= values.keys(), str(expected)
        )
        assert reported_keys(values) == set(DIAGNOSTIC_VALUES[node])
        if node == "ik_node":
            assert float(values["solve time p50 [us]"]) > 0.0
            assert 0.0 < float(values["latency p50 [us]"]) < 1e6 * PATIENCE


def test_both_nodes_have_the_topics_and_services_that_are_documented(
    launch: Callable[..., Any], client: Any
) -> None:
    """With these types, besides those that every ROS node has."""
    launch("ik_node")
    launch("fake_robot")
    client.connect(TARGET, "tracking_error/position")
    documented = {f"/{topic.name.lstrip('/')}": topic.type for topic in TOPICS}
    for node in ("ik_node", "fake_robot"):
        own = {
            name: kind
            for name, kind in client.topics_of(node).items()
            if name not in ("/rosout", "/parameter_events", "/ik_node/transition_event")
            # Where tf2 is installed.
            and name not in ("/tf", "/tf_static")
        }
        assert own.items() <= documented.items()

    def services() -> dict[str, str]:
        return {
            name.replace("/ik_node", "~"): types[0]
            for name, types in client.node.get_service_names_and_types_by_node("ik_node", "/")
            if "parameter" not in name and "type_description" not in name
        }

    documented = {service.name: service.type for service in SERVICES}
    if service_type() is None:
        del documented[COMPUTE_IK]
    # They are discovered one by one.
    client.wait_until(lambda: len(services()) >= len(documented), "all services")
    assert services() == documented
