"""Joint states as other systems publish them: floods, parts, other names, and what can't be used.

An arm stands 1.26 rad from the target of its first command: without a measurement it would leap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from invariants import wait_for_counts
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from support.client import Client
from support.processes import PATIENCE

from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds

ARM = load_robot("ur5e")
NAMES = ARM.joint_names
_LOWER, _UPPER = ARM.joint_box.lower, ARM.joint_box.upper
AT, GOAL = _LOWER + 0.3 * (_UPPER - _LOWER), _LOWER + 0.7 * (_UPPER - _LOWER)
FINGER = ("finger_joint",)
#: As long as a test takes; only the messages count then, not the speed of the machine.
WITHOUT_END = ("-p", f"measurement_timeout:={PATIENCE}")


def _pose(robot: Robot, joint_positions: FloatArray) -> FloatArray:
    return robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]


def _message(names: Any, positions: Any, stamp: int = 1, velocity: Any = ()) -> JointState:
    return JointState(
        header=joint_state_from_array([], (), stamp_from_nanoseconds(stamp)).header,
        name=list(names),
        position=[float(position) for position in positions],
        velocity=[float(value) for value in velocity],
    )


class _Driver:
    """Publishes joint states."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._timers: list[Any] = []
        self.publisher = client.node.create_publisher(
            JointState, "joint_states", QoSProfile(depth=1000)
        )
        client.wait_until(self.publisher.get_subscription_count, "the node listens")

    def repeat(self, rate: float, *messages: JointState | bytes) -> None:
        """Publish these again and again [Hz]."""

        def publish() -> None:
            for message in messages:
                self.publisher.publish(message)

        self._timers.append(self._client.node.create_timer(1.0 / rate, publish))

    def is_heard(self, message: JointState) -> int:
        """Publish a message until the node knows where the robot is; how many it has received."""
        self.repeat(20.0, message)
        self._client.wait_for_status(
            "ik_node",
            lambda values: values["measured joint positions"] == "known",
            "the robot is measured",
        )
        self.stop()
        self._client.take_messages(0.2)
        _, values = self._client.wait_for_status("ik_node", lambda _: True, "any state")
        return int(values["joint states received"])

    def stop(self) -> None:
        """Publish no more."""
        for timer in self._timers:
            self._client.node.destroy_timer(timer)
        self._timers.clear()


def _warnings(node: Any) -> list[str]:
    return [line for line in node.log.splitlines() if "/joint_states: " in line]


def _wait_for_joint_states(client: Client, count: int) -> dict[str, str]:
    return client.wait_for_status(
        "ik_node",
        lambda values: int(values.get("joint states received", 0)) >= count,
        f"{count} joint states",
    )[1]


@dataclass(frozen=True)
class Scenario:
    """What is published, and what is right.

    Attributes:
        messages: published again and again.
        reason: part of the reason that a command is refused for.
        said: part of the only warning, or None if there is nothing to warn of.
        fault: what is counted, or None.
    """

    messages: tuple[JointState | bytes, ...]
    reason: str
    said: str | None = None
    fault: str | None = None


USABLE = "is measured at"
PLAIN = _message(NAMES, AT)
SCENARIOS = {
    "plain": Scenario((PLAIN,), USABLE),
    "split": Scenario((_message(NAMES[:3], AT[:3]), _message(NAMES[3:], AT[3:])), USABLE),
    "each joint alone": Scenario(
        tuple(_message([name], [value]) for name, value in zip(NAMES, AT, strict=True)), USABLE
    ),
    "prefixed": Scenario(
        (_message([f"left_{name}" for name in NAMES], AT),),
        "the joint states lack shoulder_pan_joint",
        "with the prefix 'left_'",
    ),
    "a gripper alone": Scenario(
        (_message(FINGER, [0.02]),), "lack shoulder_pan_joint", "others are named: finger_joint"
    ),
    "a part alone": Scenario((_message(NAMES[:5], AT[:5]),), "lack wrist_3_joint", "wrist_3"),
    "NaN": Scenario(
        (_message(NAMES, AT * np.nan),),
        "shoulder_pan_joint at nan",
        "shoulder_pan_joint at nan",
        "position not finite",
    ),
    "NaN of another": Scenario((_message((*NAMES, *FINGER), [*AT, np.nan]),), USABLE),
    "one short": Scenario(
        (_message((*NAMES, *FINGER), AT),),
        "7 names but 6 positions",
        "7 names but 6 positions",
        "not one position per name",
    ),
    "twice": Scenario(
        (_message((*NAMES, NAMES[0]), [*AT, AT[0]]),),
        "shoulder_pan_joint named twice",
        "shoulder_pan_joint named twice",
        "joint named twice",
    ),
    "velocities between": Scenario((PLAIN, _message(NAMES, [], velocity=[0.0] * 6)), USABLE),
    "velocities alone": Scenario(
        (_message(NAMES, [], velocity=[0.0] * 6),), "lack shoulder_pan_joint", "lack shoulder_pan"
    ),
    "bytes that are no message": Scenario(
        (b"\x00\x01\x00\x00nonsense",), "not a JointState", "not a JointState", "malformed"
    ),
    "such bytes between": Scenario(
        (b"\x00\x01\x00\x00nonsense", PLAIN), USABLE, "not a JointState", "malformed"
    ),
    "a stamp of zero": Scenario((_message(NAMES, AT, 0),), USABLE),
    "a stamp in the future": Scenario((_message(NAMES, AT, (2**31 - 1) * 10**9),), USABLE),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_depends_on_the_robot_is_refused_unless_it_is_measured_near(
    launch: Callable[..., Any], client: Client, name: str
) -> None:
    """The first command, and every command with max_measured_step; with the reason, said once."""
    scenario = SCENARIOS[name]
    node = launch("ik_node", "-p", "model:=ur5e")
    driver = _Driver(client)
    driver.repeat(20.0, *scenario.messages)
    if scenario.said is not None:
        client.wait_until(lambda: _warnings(node), "the node says what it can't use")
    _wait_for_joint_states(client, 10)
    assert client.set_parameter("ik_node", "measurement_timeout", PATIENCE).successful
    client.send(_pose(ARM, GOAL))
    assert wait_for_counts(client, 1).reasons == {"first command too far": 1}
    limits = {"first_command": "free", "max_measured_step": 0.5}
    assert client.set_parameters_atomically("ik_node", limits).successful
    client.send(_pose(ARM, GOAL))
    assert wait_for_counts(client, 2).reasons["too far from measured"] == 1
    found = client.status("ik_node")
    assert found is not None
    values = found[1]
    assert scenario.reason in values["last refusal"]
    known = scenario.reason is USABLE
    assert (values["measured joint positions"] == "known") == known
    unusable = {key for key in values if key.startswith("joint states unusable: ")}
    expected = set() if scenario.fault is None else {f"joint states unusable: {scenario.fault}"}
    assert unusable == expected
    if scenario.said is None:
        assert not _warnings(node)
    else:
        (line,) = _warnings(node)
        assert scenario.said in line
    assert not client.received["joint_command"]
    # It serves as soon as the robot is measured there.
    driver.stop()
    driver.repeat(20.0, _message(NAMES, GOAL))
    client.repeat_until(
        lambda: client.send(_pose(ARM, GOAL)),
        lambda: client.received["joint_command"],
        "a command near the robot",
    )


def test_a_robot_that_reports_nothing_is_not_waited_for(
    launch: Callable[..., Any], client: Client
) -> None:
    node = launch("ik_node", "-p", "model:=ur5e", "-p", "max_measured_step:=0.5")
    client.send(_pose(ARM, GOAL))
    client.wait_until(lambda: client.received["joint_command"], "the first command")
    assert not _warnings(node)
    _, values = client.wait_for_status("ik_node", lambda _: True, "any state")
    assert values["measured joint positions"] == "no joint states"


@pytest.mark.parametrize("others", [0, 4, 25, 250, 2500])
def test_however_many_messages_of_a_gripper_come_between_the_arm_counts(
    launch: Callable[..., Any], client: Client, others: int
) -> None:
    """One message of the arm, and then those of the gripper."""
    launch("ik_node", "-p", "model:=ur5e", *WITHOUT_END)
    driver = _Driver(client)
    received = driver.is_heard(PLAIN)
    for sent in range(1, others + 1):
        driver.publisher.publish(_message(FINGER, [0.02]))
        if sent % 50 == 0:
            # Best effort: no more at a time than are kept.
            client.take_messages(0.02)
    values = _wait_for_joint_states(client, received + others // 2)
    assert values["measured joint positions"] == "known"
    client.send(_pose(ARM, GOAL))
    assert wait_for_counts(client, 1).reasons == {"first command too far": 1}
    found = client.status("ik_node")
    assert found is not None
    assert USABLE in found[1]["last refusal"]
    client.send(_pose(ARM, AT))
    client.wait_until(lambda: client.received["joint_command"], "a command near the robot")
    (command,) = client.received["joint_command"]
    assert np.abs(np.array(command.position) - AT).max() < 0.2


@pytest.mark.parametrize("executor", ["events", "single_threaded"])
def test_an_arm_beside_a_gripper_of_a_high_rate_counts(
    launch: Callable[..., Any], client: Client, executor: str
) -> None:
    """Five messages a second of the arm among a thousand and more; with default limits."""
    launch("ik_node", "-p", "model:=ur5e", "-p", f"executor:={executor}")
    driver = _Driver(client)
    driver.repeat(5.0, PLAIN)
    driver.repeat(50.0, *[_message(FINGER, [0.02])] * 25)
    _wait_for_joint_states(client, 1000)
    refused = 0

    def send_far() -> None:
        nonlocal refused
        client.send(_pose(ARM, GOAL))
        refused += 1
        reasons = wait_for_counts(client, refused).reasons
        assert reasons == {"first command too far": refused}

    def last_refusal() -> str:
        found = client.status("ik_node")
        return "" if found is None else found[1]["last refusal"]

    # A machine that is busy elsewhere for half a second may lose sight of the arm.
    client.repeat_until(send_far, lambda: USABLE in last_refusal(), "the arm is measured", 0.0)
    assert not client.received["joint_command"]
    client.repeat_until(
        lambda: client.send(_pose(ARM, AT)),
        lambda: client.received["joint_command"],
        "a command near the robot",
    )


class TestContinuousJoint:
    """The robot stands at -3.10 rad of a joint that turns without limits."""

    @pytest.fixture
    def robot(self, continuous_model: Path) -> Robot:
        return load_model(continuous_model).robot

    def places(self, robot: Robot, swivel: Any) -> FloatArray:
        joints = np.tile(robot.joint_box.centre, (len(swivel), 1))
        joints[:, 0] = swivel
        return joints

    @pytest.mark.parametrize("turns", [-1, 0, 2])
    def test_is_commanded_the_short_way_over_the_seam_and_back(
        self,
        launch: Callable[..., Any],
        client: Client,
        robot: Robot,
        continuous_model: Path,
        turns: int,
    ) -> None:
        """By the turns that the robot counts; 2.5 rad is too far for a first command."""
        launch(
            "ik_node",
            *("-p", f"model:={continuous_model}", "-p", "max_joint_step:=0.2"),
            *("-p", "max_measured_step:=0.2", *WITHOUT_END),
        )
        driver = _Driver(client)
        shift = 2.0 * np.pi * turns
        at = self.places(robot, [-3.10 + shift])[0]
        driver.is_heard(_message(robot.joint_names, at))
        client.send(_pose(robot, self.places(robot, [2.5])[0]))
        assert wait_for_counts(client, 1).reasons == {"joint step too large": 1}
        swivel = [3.10, 3.14, -3.14, -3.10, -3.0, 3.14159, -3.14159, 3.05]
        expected = [angle + shift - (2.0 * np.pi if angle > 0 else 0.0) for angle in swivel]
        for count, target in enumerate(self.places(robot, swivel), 1):
            client.send(_pose(robot, target))
            client.wait_until(
                lambda count=count: len(client.received["joint_command"]) == count,
                f"command {count}",
            )
        commands = [message.position[0] for message in client.received["joint_command"]]
        np.testing.assert_allclose(commands, expected, atol=1e-4)

    def test_a_path_over_the_seam_is_unwrapped(
        self,
        launch: Callable[..., Any],
        client: Client,
        robot: Robot,
        continuous_model: Path,
    ) -> None:
        from geometry_msgs.msg import PoseArray
        from trajectory_msgs.msg import JointTrajectory

        from msg_tools.conversions.pose import pose_from_array

        client.listen("joint_trajectory", JointTrajectory)
        launch(
            "ik_node",
            *("-p", f"model:={continuous_model}", "-p", "max_joint_velocity:=1.2", *WITHOUT_END),
        )
        driver = _Driver(client)
        driver.is_heard(_message(robot.joint_names, self.places(robot, [-3.10])[0]))
        swivel = np.arange(3.10, 3.10 + 2.5 * np.pi, 0.1)
        poses = robot.forward_kinematics.poses(self.places(robot, swivel))
        path = client.node.create_publisher(PoseArray, "target_poses", QoSProfile(depth=10))
        client.wait_until(path.get_subscription_count, "a subscriber of the paths")
        path.publish(PoseArray(poses=[pose_from_array(pose) for pose in poses]))
        client.wait_until(lambda: client.received["joint_trajectory"], "the trajectory")
        (trajectory,) = client.received["joint_trajectory"]
        positions = [point.positions[0] for point in trajectory.points]
        np.testing.assert_allclose(positions, swivel - 2.0 * np.pi, atol=1e-4)
