"""Bags of a robot that follows a path with a known error, made without ROS."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray, tracking_error
from msg_tools.bags.metadata import jazzy_types
from msg_tools.bags.writer import BagWriter
from msg_tools.topics import TOPICS

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000

TYPES = {topic.name: topic.type for topic in TOPICS}


def make(message_type: str, **fields: Any) -> Any:
    return jazzy_types().types[message_type](**fields)


def pose_message(pose: Sequence[float]) -> Any:
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=pose[0], y=pose[1], z=pose[2]),
        orientation=make(
            "geometry_msgs/msg/Quaternion", x=pose[3], y=pose[4], z=pose[5], w=pose[6]
        ),
    )


def header(stamp_ns: int, frame: str = "base") -> Any:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    stamp = make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def stamped_pose(stamp_ns: int, pose: Sequence[float]) -> Any:
    return make("geometry_msgs/msg/PoseStamped", header=header(stamp_ns), pose=pose_message(pose))


def stamped_vector(stamp_ns: int, vector: Sequence[float]) -> Any:
    return make(
        "geometry_msgs/msg/Vector3Stamped",
        header=header(stamp_ns),
        vector=make("geometry_msgs/msg/Vector3", x=vector[0], y=vector[1], z=vector[2]),
    )


def joint_state(stamp_ns: int, positions: Sequence[float]) -> Any:
    return make(
        "sensor_msgs/msg/JointState",
        header=header(stamp_ns),
        name=[f"joint_{number}" for number in range(len(positions))],
        position=np.array(positions, dtype=np.float64),
        velocity=np.array([]),
        effort=np.array([]),
    )


def diagnostics(stamp_ns: int, name: str, values: dict[str, str]) -> Any:
    entries = [
        make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in values.items()
    ]
    status = make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=0,
        name=name,
        message="",
        hardware_id="",
        values=entries,
    )
    return make("diagnostic_msgs/msg/DiagnosticArray", header=header(stamp_ns), status=[status])


@dataclass
class Message:
    """One message of a bag to be."""

    topic: str
    content: Any
    log_time_ns: int
    publish_time_ns: int

    @property
    def relative_topic(self) -> str:
        name = next(t for t in TYPES if self.topic.endswith("/" + t.lstrip("/")))
        return name

    @property
    def type(self) -> str:
        return TYPES[self.relative_topic]

    @property
    def cdr(self) -> bytes:
        return bytes(jazzy_types().serialize_cdr(self.content, self.type))


@dataclass
class RobotRecording:
    """Messages of a robot on a diagonal, 0.1 mm and 0.01 degrees off, 500 us to answer."""

    count: int = 10
    namespace: str = ""
    latency_ns: int = 500_000
    refused: Sequence[int] = ()
    messages: list[Message] = field(default_factory=list)

    def __post_init__(self) -> None:
        for number in range(self.count):
            self.add_target(number, answered=number not in self.refused)

    def target(self, number: int) -> FloatArray:
        part = number / max(1, self.count - 1)
        quaternion = Rotation.from_euler("xyz", [0.0, 0.3 * part, 0.0]).as_quat()
        return np.array([part, 0.5 * part, 0.2 * part, *quaternion])

    def achieved(self, number: int) -> FloatArray:
        target = self.target(number)
        off = Rotation.from_rotvec([0.0, 0.0, np.radians(0.01)])
        turned = off * Rotation.from_quat(target[3:])
        return np.array([target[0] + 1e-4, *target[1:3], *turned.as_quat()])

    def stamp(self, number: int) -> int:
        return START_NS + number * PERIOD_NS + 100_000

    def add(self, topic: str, content: Any, sent_ns: int) -> None:
        name = topic if topic.startswith("/") else f"{self.namespace}/{topic}"
        self.messages.append(Message(name, content, sent_ns + 50_000, sent_ns))

    def add_target(self, number: int, *, answered: bool = True) -> None:
        sent = START_NS + number * PERIOD_NS
        stamp = self.stamp(number)
        target, achieved = self.target(number), self.achieved(number)
        self.add("target_pose", pose_message(target), sent)
        if not answered:
            return
        error = tracking_error(target, achieved)
        done = sent + self.latency_ns
        self.add("joint_command", joint_state(stamp, [0.1] * 6), done)
        self.add("accepted_target", stamped_pose(stamp, target), done)
        self.add("joint_states", joint_state(stamp, [0.1] * 6), done + 1000)
        self.add("achieved_pose", stamped_pose(stamp, achieved), done + 2000)
        self.add("tracking_error/position", stamped_vector(stamp, error.position), done + 3000)
        self.add(
            "tracking_error/orientation", stamped_vector(stamp, error.orientation), done + 4000
        )

    def add_diagnostics(
        self, reasons: dict[str, int], name: str = "ik_node: targets", last: str = ""
    ) -> None:
        refused = sum(reasons.values())
        values = {
            "targets received": str(self.count),
            "targets accepted": str(self.count - refused),
            "targets refused": str(refused),
        }
        values |= {f"refused: {reason}": str(count) for reason, count in reasons.items()}
        values["last refusal"] = last
        stamp = self.stamp(self.count)
        self.add("/diagnostics", diagnostics(stamp, name, values), stamp)

    def without(self, *topics: str) -> RobotRecording:
        self.messages = [m for m in self.messages if m.relative_topic not in topics]
        return self

    def shuffled(self, seed: int = 1) -> RobotRecording:
        random.Random(seed).shuffle(self.messages)
        return self

    def write(self, directory: Path) -> Path:
        write_bag(directory, self.messages)
        return directory


def write_bag(directory: Path, messages: Sequence[Message]) -> None:
    with BagWriter(directory) as writer:
        for message in messages:
            writer.add_topic(message.topic, message.type)
            writer.write(message.topic, message.cdr, message.log_time_ns, message.publish_time_ns)
