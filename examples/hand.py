"""A simulated person: guides a ``fake_robot`` to joint positions and has each of them recorded.

``python -m examples.hand ROBOT POSITIONS [RECORDED]``: a robot's name or file, the file of the
joint positions to guide it to, and the one that ``example_collector`` writes with ``by_hand``;
without it, the arm is only guided to the first of them.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.topics import JOINT_COMMAND, JOINT_STATES

RECORD = "example_collector/record"
#: How long the person holds the arm still before a call [s]: more than ``settle_time``.
_HOLD = 0.12
#: Longest time for one row [s]; a loaded machine is slow.
_PATIENCE = 60.0


class Hand:
    """Guides the arm, which is where it says that it is."""

    def __init__(self, robot: str) -> None:
        self._names = load_robot(robot).joint_names
        self._node = rclpy.create_node("hand")
        self._commands = self._node.create_publisher(JointState, JOINT_COMMAND.name, 10)
        self._record = self._node.create_client(Trigger, RECORD)
        self._node.create_subscription(
            JointState, JOINT_STATES.name, self._on_joint_state, qos_profile_sensor_data
        )
        self._place: dict[str, float] = {}

    def _on_joint_state(self, state: JointState) -> None:
        self._place = dict(zip(state.name, state.position, strict=False))

    def guide(self, row: FloatArray) -> None:
        """Guide the arm to joint positions ``(dof,)``, and wait until it is there."""
        deadline = time.monotonic() + _PATIENCE
        while [self._place.get(name) for name in self._names] != row.tolist():
            if time.monotonic() > deadline:
                sys.exit(f"the arm did not come to {row} within {_PATIENCE:g} s")
            stamp = self._node.get_clock().now().to_msg()
            self._commands.publish(joint_state_from_array(row, self._names, stamp))
            rclpy.spin_once(self._node, timeout_sec=0.05)

    def have_recorded(self, row: FloatArray, recorded: Path) -> None:
        """Have the place of the arm recorded until it is in the file.

        A call may come before the collector has seen that the arm moved: the row before is there
        twice then.
        """
        deadline = time.monotonic() + _PATIENCE
        while not np.array_equal(_rows(recorded)[-1:], row[np.newaxis]):
            if time.monotonic() > deadline:
                sys.exit(f"{row} was not recorded in {recorded} within {_PATIENCE:g} s")
            time.sleep(_HOLD)
            if self._record.service_is_ready():
                answer = self._record.call_async(Trigger.Request())
                rclpy.spin_until_future_complete(self._node, answer, timeout_sec=1.0)


def main(robot: str, positions: Path, recorded: Path | None) -> None:
    """Guide the arm to every row, and have each recorded."""
    rclpy.init()
    hand, rows = Hand(robot), _rows(positions)
    if recorded is None:
        hand.guide(rows[0])
    else:
        for row in rows:
            hand.guide(row)
            hand.have_recorded(row, recorded)
    rclpy.shutdown()


def _rows(path: Path) -> FloatArray:
    """The rows of a file, none if it is missing or empty."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return np.array([[float(number) for number in line.split(",")] for line in text.split()])


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]) if sys.argv[3:] else None)
