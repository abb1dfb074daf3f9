"""Targets in other frames, by a stand-in for tf2_ros, which comes in no wheel."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from rclpy.clock import ClockType
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time
from scipy.spatial.transform import Rotation
from std_msgs.msg import Header
from support.processes import ROOT
from trajectory_msgs.msg import JointTrajectory

from annik_core.pose import FloatArray, pose_distance, pose_from_roll_pitch_yaw
from annik_ros.ik_node.frames import TargetFrames
from msg_tools.conversions.pose import pose_from_array, pose_to_array

TARGET = pose_from_roll_pitch_yaw([0.3001, 0.4, 0.6], [0.5, 0.4, 0.3])
#: Where the camera is in the base frame.
CAMERA = pose_from_roll_pitch_yaw([0.7, -0.2, 1.1], [2.0, 0.3, -1.2])

TF2_ROS = """
from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

POSE = {pose}
# Seconds from now, or None: static, or without a stamp.
STAMPS = dict(camera=0.0, map=0.5, wall=None, unstamped=None, old=-30.0, future=30.0, broken=0.0)

class TransformException(Exception):
    pass

class Buffer:
    listened = False
    cleared = 0

    def clear(self):
        self.cleared += 1

    def lookup_transform(self, target_frame, source_frame, time, timeout=Duration()):
        assert self.listened and target_frame == "base_link"
        # What has no stamp is found at time zero alone.
        if source_frame not in STAMPS or (source_frame == "unstamped" and time != Time()):
            raise TransformException(f"{{source_frame}} does not exist")
        found = TransformStamped()
        if STAMPS[source_frame] is not None:
            stamp = Clock().now() + Duration(nanoseconds=int(1e9 * STAMPS[source_frame]))
            found.header.stamp = stamp.to_msg()
        p, q = found.transform.translation, found.transform.rotation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = POSE
        if source_frame == "broken":
            q.w = float("nan")
        return found

class TransformListener:
    def __init__(self, buffer, node):
        assert isinstance(node, Node)
        buffer.listened = True
"""


@pytest.fixture
def with_tf2(tmp_path: Path) -> dict[str, str]:
    (tmp_path / "tf2_ros.py").write_text(TF2_ROS.format(pose=CAMERA.tolist()), encoding="utf-8")
    return {"PYTHONPATH": f"{tmp_path}:{ROOT}:{os.environ.get('PYTHONPATH', '')}"}


def test_transforms_from_before_a_simulation_began_anew_are_forgotten(
    domain: int, with_tf2: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They would be the newest ones for as long as it takes to get there again."""
    monkeypatch.syspath_prepend(with_tf2["PYTHONPATH"].split(":")[0])
    monkeypatch.delitem(sys.modules, "tf2_ros", raising=False)
    context = Context()
    context.init(domain_id=domain)
    node = Node("simulated", context=context)
    try:
        clock = node.get_clock()
        clock._set_ros_time_is_active(True)
        frames = TargetFrames(node, 0.5)
        for seconds, cleared in ((100, 0), (101, 0), (101, 0), (5, 1), (6, 1)):
            clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
            assert frames._buffer.cleared == cleared
    finally:
        node.destroy_node()
        context.try_shutdown()
        monkeypatch.delitem(sys.modules, "tf2_ros", raising=False)


def in_camera_frame(pose: FloatArray) -> FloatArray:
    """The pose as the camera sees it."""
    back = Rotation.from_quat(CAMERA[3:]).inv()
    turned = back * Rotation.from_quat(pose[3:])
    return np.concatenate([back.apply(pose[:3] - CAMERA[:3]), turned.as_quat()])


def test_a_target_in_another_frame_is_transformed_or_refused_and_counted(
    launch: Callable[..., Any], client: Any, with_tf2: dict[str, str]
) -> None:
    """By the newest transform, which may be static; not by an old or broken one, or none."""
    node = launch("ik_node", "-p", "queue_depth:=100", environment=with_tf2)
    client.connect(TARGET)
    seen = in_camera_frame(TARGET)

    def send(frame: str) -> None:
        stamp = time.time_ns()
        client.stamped_target.publish(client.pose_stamped(seen, stamp, frame))

    accepted = client.received["accepted_target"]
    for frame in ("camera", "map", "wall"):
        before = len(accepted)
        client.repeat_until(
            lambda frame=frame: send(frame), lambda before=before: len(accepted) > before, frame
        )
        assert accepted[-1].header.frame_id == "base_link"
        distances = pose_distance(pose_to_array(accepted[-1].pose), TARGET)
        np.testing.assert_allclose(distances, 0.0, atol=1e-9)
    client.take_the_rest()
    commands = len(client.received["joint_command"])
    refused = ("old", "future", "broken", "unstamped", "nowhere", "/base_link")
    for frame in refused:
        send(frame)
    _, values = client.wait_for_status(
        "ik_node",
        lambda values: int(values.get("refused: wrong frame", 0)) >= len(refused),
        "refusals",
    )
    assert int(values["targets refused"]) == int(values["refused: wrong frame"]) == len(refused)
    assert len(client.received["joint_command"]) == commands
    assert node.is_running and "Traceback" not in node.log
    # A path too, as a whole.
    client.listen("joint_trajectory", JointTrajectory)
    paths = client.node.create_publisher(PoseArray, "target_poses", QoSProfile(depth=10))
    path = PoseArray(header=Header(frame_id="camera"), poses=[pose_from_array(seen)] * 3)
    client.repeat_until(
        lambda: paths.publish(path), lambda: client.received["joint_trajectory"], "a trajectory"
    )
    assert len(client.received["joint_trajectory"][0].points) == 3


def test_no_transform_is_taken_if_the_timeout_is_zero(
    launch: Callable[..., Any], client: Any, with_tf2: dict[str, str]
) -> None:
    """As without tf2_ros."""
    launch("ik_node", "-p", "transform_timeout:=0.0", environment=with_tf2)
    client.connect(TARGET)
    client.repeat_until(
        lambda: client.stamped_target.publish(
            client.pose_stamped(in_camera_frame(TARGET), time.time_ns(), "camera")
        ),
        lambda: client.status("ik_node") and "refused: wrong frame" in client.status("ik_node")[1],
        "a refusal",
    )
