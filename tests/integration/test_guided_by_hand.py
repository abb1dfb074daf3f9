"""An arm that a person guides is recorded on calls over DDS, while it stands still."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_training.calibration.measurement_files import read_sockets
from msg_tools.conversions.joint_state import joint_state_from_array


def test_what_a_person_guides_is_recorded_where_it_stands(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """In the file of a calibration; refused while it moves, and without joint states."""
    robot = load_robot("ur5e")
    path = tmp_path / "measured" / "placement_0" / "hole_0.csv"
    node = launch(
        "example_collector",
        *("-p", "robot:=ur5e", "-p", f"by_hand:={path}", "-p", "measurement_timeout:=5.0"),
        ready=False,
    )
    node.wait_for_text("guided by hand")
    assert not client.call("example_collector/record").success
    states = client.node.create_publisher(JointState, "joint_states", 100)
    where = np.linspace(-1.0, 1.0, robot.dof)
    moving = [False]

    def publish() -> None:
        if moving[0]:
            where[2] += 0.01
        states.publish(joint_state_from_array(where, robot.joint_names))

    timer = client.node.create_timer(0.02, publish)

    def record() -> Any:
        answers: list[Any] = []
        client.repeat_until(
            lambda: answers.append(client.call("example_collector/record")),
            lambda: answers and answers[-1].success,
            "a row",
        )
        return answers[-1]

    first: FloatArray = where.copy()
    assert robot.joint_names[0] in record().message
    moving[0] = True
    client.take_messages(0.3)
    refused = client.call("example_collector/record")
    assert not refused.success
    assert robot.joint_names[2] in refused.message
    moving[0] = False
    record()
    rows = read_sockets(robot, [tmp_path / "measured"]).joint_positions
    np.testing.assert_array_equal(rows[[0, -1]], [first, where])
    assert not client.received["joint_command"]
    client.node.destroy_timer(timer)
    node.signal(signal.SIGINT)
    assert node.wait_for_exit() == 0
