"""What RViz needs, before any command: joint states at a rate, the URDF, transforms of the links.

tf2_msgs comes in no wheel: a stand-in for it is published to a recorder.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from support.processes import run_python

from annik_core.reachable_paths import start_positions
from annik_core.robots.description import robot_urdf
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot

#: Runs a fake robot with the arguments until it has published transforms; prints some of them.
SCRIPT = """
import json, sys
from types import ModuleType
class TFMessage:
    def __init__(self, transforms):
        self.transforms = transforms
for name in ("tf2_msgs", "tf2_msgs.msg"):
    sys.modules[name] = ModuleType(name)
sys.modules["tf2_msgs.msg"].TFMessage = TFMessage
import rclpy
from rclpy.node import Node
published, create = [], Node.create_publisher
class Recorder:
    def publish(self, message):
        published.append(message.transforms)
def create_publisher(self, message_type, topic, *rest, **how):
    if message_type is TFMessage:
        assert topic == "tf"
        return Recorder()
    return create(self, message_type, topic, *rest, **how)
Node.create_publisher = create_publisher
from annik_ros.fake_robot.node import FakeRobotNode
rclpy.init(args=["--ros-args", *sys.argv[1:]])
node = FakeRobotNode()
while len(published) < 3:
    rclpy.spin_once(node)
stamps = [transforms[0].header.stamp for transforms in published]
print(json.dumps({
    "stamps": [stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps],
    "links": {one.child_frame_id: [one.header.frame_id] + [
        getattr(part, axis) for part, axes in (
            (one.transform.translation, "xyz"), (one.transform.rotation, "xyzw"),
        ) for axis in axes
    ] for one in published[-1]},
}))
"""


def _in(domain: int) -> dict[str, str]:
    return {"ROS_DOMAIN_ID": str(domain)}


def listen_latched(client: Any, topic: str) -> list[str]:
    """The texts of a latched topic, also those published before."""
    texts: list[str] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(
        String, topic, lambda message: texts.append(message.data), latched
    )
    return texts


@pytest.mark.parametrize("name", ["gantry", "ur5e"])
def test_before_any_command_it_has_joint_states_and_a_description(
    launch: Callable[..., Any], client: Any, name: str
) -> None:
    """At 50 Hz, with stamps of now; and latched, for whoever comes later."""
    robot = load_robot(name)
    launch("fake_robot", "-p", f"robot:={name}")
    began = time.time_ns()
    states = client.received["joint_states"]
    client.wait_until(lambda: len(states) >= 60, "joint states")
    stamps = client.stamps("joint_states")
    assert stamps == sorted(set(stamps))
    assert stamps[0] > began - 5e9 and stamps[-1] <= time.time_ns()
    # A loaded machine publishes less often, and never more often.
    assert 0.019 < 1e-9 * np.diff(stamps).mean() < 0.2
    for state in states:
        assert tuple(state.name) == robot.joint_names
        np.testing.assert_array_equal(state.position, start_positions(robot))
    texts = listen_latched(client, "robot_description")
    client.wait_until(lambda: texts, "the description")
    assert texts == [robot_urdf(robot)]


def test_a_given_description_is_published_as_it_is_and_none_if_not_wanted(
    launch: Callable[..., Any], client: Any
) -> None:
    given = robot_urdf(load_robot("ur5e")).replace("sphere", "sphere ")
    ElementTree.fromstring(given)
    launch("fake_robot", "-p", f"robot_description:={json.dumps(given)}", "-r", "__ns:=/given")
    launch("fake_robot", "-p", "publish_robot_description:=false", "-r", "__ns:=/none")
    texts = listen_latched(client, "given/robot_description")
    client.wait_until(lambda: texts, "the description")
    assert texts == [given]
    assert client.node.count_publishers("/none/robot_description") == 0


@pytest.mark.parametrize("name", ["gantry", "ur5e"])
def test_the_transforms_of_its_links_lead_to_its_pose(domain: int, name: str) -> None:
    """Each in the base frame, with the stamp of the joint states, from the start on."""
    robot: Robot = load_robot(name)
    result = run_python("-c", SCRIPT, "-p", f"robot:={name}", environment=_in(domain))
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout.splitlines()[-1])
    assert found["stamps"] == sorted(set(found["stamps"]))
    assert {frame for frame, *_ in found["links"].values()} == {robot.base_frame}
    start = robot.forward_kinematics.poses(start_positions(robot)[None])[0]
    _, *pose = found["links"][robot.end_effector_frame]
    sign = np.sign(np.dot(pose[3:], start[3:]))
    np.testing.assert_allclose([*pose[:3], *(sign * np.array(pose[3:]))], start, atol=1e-9)
    assert set(found["links"]) == {
        child.attrib["link"] for child in ElementTree.fromstring(robot_urdf(robot)).iter("child")
    }


def test_without_tf2_msgs_it_says_so(domain: int) -> None:
    """And goes on."""
    script = (
        "import sys; sys.modules['tf2_msgs'] = None; import rclpy; rclpy.init(); "
        "from annik_ros.fake_robot.node import FakeRobotNode; node = FakeRobotNode(); "
        "rclpy.spin_once(node); print(node.get_topic_names_and_types())"
    )
    result = run_python("-c", script, environment=_in(domain))
    assert result.returncode == 0, result.stderr
    assert "tf2_msgs" in result.stdout + result.stderr
    assert "/robot_description" in result.stdout and "'/tf'" not in result.stdout
