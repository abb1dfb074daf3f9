"""Measured joint positions of a robot, from its joint states."""

import time

from rclpy.node import Node
from sensor_msgs.msg import JointState

from annik_core.safety import Measurement
from annik_core.serving.measured_joints import JointStateFault, MeasuredJoints, MeasuredPositions
from annik_ros.qos import best_effort
from msg_tools.conversions.cdr import MalformedMessage, joint_positions_from_bytes
from msg_tools.topics import JOINT_STATES

#: Deep enough for a burst of many publishers.
_JOINT_STATES_QOS = best_effort(100)


class MeasuredJointPositions:
    """Reads every joint state as it arrives, and merges them by name and time."""

    def __init__(self, node: Node, joint_names: tuple[str, ...], timeout: float) -> None:
        self.joints = MeasuredJoints(joint_names, timeout)
        self._node = node
        self._said: set[JointStateFault | None] = set()
        self._subscription = node.create_subscription(
            JointState, JOINT_STATES.name, self._on_message, _JOINT_STATES_QOS, raw=True
        )

    def __call__(self) -> Measurement:
        """Where the robot is now."""
        now = time.monotonic()
        newest = self.joints.newest(now)
        if newest is None:
            return Measurement(None, self.joints.missing(now))
        return Measurement(newest.joint_positions)

    def newest(self) -> MeasuredPositions | None:
        """The newest position of every joint, or None if one is unknown or too old."""
        return self.joints.newest(time.monotonic())

    def missing(self) -> str | None:
        """Why :meth:`newest` is None although joint states arrive, as the end of a sentence."""
        return self.joints.missing(time.monotonic())

    def diagnostic_values(self) -> dict[str, str]:
        """Counts of the joint states, and whether the joint positions are known."""
        joints = self.joints
        unusable = {
            f"joint states unusable: {fault.value}": str(count)
            for fault, count in joints.faults.items()
            if count
        }
        unknown = self.missing() or "no joint states"
        return {
            "joint states received": str(joints.received),
            "joint states of other joints": str(joints.foreign),
            **unusable,
            "measured joint positions": "known" if self.newest() else unknown,
        }

    @property
    def topic_name(self) -> str:
        """The resolved name of the topic."""
        return str(self._subscription.topic_name)

    def destroy(self) -> None:
        """Take the subscription off the node."""
        self._node.destroy_subscription(self._subscription)

    def _on_message(self, data: bytes) -> None:
        arrival = time.monotonic()
        fault: JointStateFault | None
        try:
            message = joint_positions_from_bytes(data)
        except MalformedMessage as error:
            fault = self.joints.malformed(arrival, str(error))
        else:
            fault = self.joints.update(arrival, message.names, message.positions)
        if fault in self._said:
            return
        if fault is not None:
            text = f"a joint state can't be used: {self.joints.last_fault}"
        elif self.joints.stays_unknown(arrival):
            text = f"the joint positions are unknown: {self.joints.missing(arrival)}"
        else:
            return
        self._said.add(fault)
        self._node.get_logger().warning(
            f"{self.topic_name}: {text}; said once, and counted in /diagnostics"
        )
