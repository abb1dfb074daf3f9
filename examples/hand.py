"""A simulated person: guides a ``fake_robot`` to joint positions and has each of them recorded.

``python -m examples.hand ROBOT POSITIONS RECORDED``: a robot's name or file, the file of the joint
positions to guide it to, and the one that ``example_collector`` writes with ``by_hand``.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.topics import JOINT_COMMAND

RECORD = "example_collector/record"
#: How long the person holds the arm still before a call [s]; and at first, since a row of another
#: socket would be wrong in this file. More than ``settle_time``.
_HOLD, _FIRST_HOLD = 0.12, 1.0
#: Longest time for one row [s]; a loaded machine is slow.
_PATIENCE = 60.0


def guide(robot: str, positions: Path, recorded: Path) -> None:
    """Guide the arm to every row, and have it recorded until it is in the file."""
    names = load_robot(robot).joint_names
    rclpy.init()
    node = rclpy.create_node("hand")
    commands = node.create_publisher(JointState, JOINT_COMMAND.name, 10)
    record = node.create_client(Trigger, RECORD)
    for number, row in enumerate(_rows(positions)):
        deadline = time.monotonic() + _PATIENCE
        hold = _HOLD if number else _FIRST_HOLD
        # A call may come before the collector has seen that the arm moved: the row is there twice.
        while not np.array_equal(_rows(recorded)[-1:], row[np.newaxis]):
            if time.monotonic() > deadline:
                sys.exit(f"row {number} of {positions} was not recorded within {_PATIENCE:g} s")
            commands.publish(joint_state_from_array(row, names, node.get_clock().now().to_msg()))
            time.sleep(hold)
            if record.service_is_ready():
                answer = record.call_async(Trigger.Request())
                rclpy.spin_until_future_complete(node, answer, timeout_sec=1.0)
    rclpy.shutdown()


def _rows(path: Path) -> FloatArray:
    """The rows of a file, none if it is missing or empty."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return np.array([[float(number) for number in line.split(",")] for line in text.split()])


if __name__ == "__main__":
    guide(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))
