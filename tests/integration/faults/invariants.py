"""What must hold whatever was sent, checked on everything that a client received."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseArray
from std_msgs.msg import Float64MultiArray
from support.client import Client
from trajectory_msgs.msg import JointTrajectory

from annik_core.installation import default_model_path
from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray, checked_pose, pose_from_roll_pitch_yaw
from annik_core.robots.robot import Robot
from msg_tools.conversions.pose import pose_from_array, pose_to_array

GOOD = pose_from_roll_pitch_yaw([0.3001, 0.4, 0.6], [0.5, 0.4, 0.3])
UNREACHABLE = pose_from_roll_pitch_yaw([2.0, 0.4, 0.6], [0.5, 0.4, 0.3])
BASE_FRAME = "base_link"

#: No command is further from its target than the node's limits allow [m].
LARGEST_ERROR = 1e-3


def good_target(number: int) -> FloatArray:
    """A target within reach of the gantry, whose x tells it from all others below 100,000."""
    pose = GOOD.copy()
    pose[0] += 1e-6 * (number + 1)
    return pose


#: What :func:`connect` sends, unlike all other targets.
CONTACTS = [good_target(-2 - number) for number in range(200)]


def connect(client: Client, result: str = "joint_command", first: int = 0) -> int:
    """Send targets until one of them has this result and no other is on its way.

    A reader that learns of its writer later than the other way round gets the first ones only
    seconds after they were sent; but in order.

    Args:
        client: what sends them.
        result: the topic of the result.
        first: which contact to begin with; of two clients, each needs its own.

    Returns:
        How many targets the node has received. What the client has received is forgotten: of the
        first results it may have missed some.
    """
    client.connect(good_target(0), result)
    contacts = iter(CONTACTS[first:])
    sent: list[FloatArray] = []

    def send_another() -> None:
        sent.append(next(contacts))
        client.send(sent[-1])

    # Only the newest one's answer says that none is on its way.
    client.repeat_until(
        send_another, lambda: sent and client.stamps_of(sent[-1]), "a contact's answer", pause=2.0
    )
    client.wait_for_results(sent[-1], [result])
    return settled(client)


def settled(client: Client) -> int:
    """How many targets the node has received, once no more come; all else is forgotten."""
    # First, so that no report is on its way that is older than the last of them.
    client.take_the_rest()
    _, values = client.wait_for_status("ik_node", lambda _: True, "any state")
    for messages in client.received.values():
        messages.clear()
    return counts_in(values).received


def gantry_robot() -> Robot:
    """The robot of the packaged model."""
    return load_model(default_model_path()).robot


@dataclass(frozen=True)
class Counts:
    """What a node reported of everything that it had received."""

    received: int
    accepted: int
    refused: int
    reasons: dict[str, int]


def counts_in(values: dict[str, str], what: str = "targets") -> Counts:
    """The counts in the values of a diagnostic report; fails unless they add up exactly."""
    reasons = {
        key.removeprefix("refused: "): int(value)
        for key, value in values.items()
        if key.startswith("refused: ")
    }
    counts = Counts(
        int(values[f"{what} received"]),
        int(values[f"{what} accepted"]),
        int(values[f"{what} refused"]),
        reasons,
    )
    assert counts.received == counts.accepted + counts.refused
    assert counts.refused == sum(reasons.values())
    assert values.get("callback errors", "0") == "0"
    return counts


def wait_for_counts(client: Client, received: int, node: str = "ik_node") -> Counts:
    """The counts of a node once it has received so many targets, and not one more."""

    def reported() -> bool:
        found = client.status(node)
        return found is not None and int(found[1].get("targets received", -1)) >= received

    client.wait_until(reported, f"a report of {received} targets received")
    found = client.status(node)
    assert found is not None
    counts = counts_in(found[1])
    assert counts.received == received
    return counts


def listen_to_all_commands(client: Client) -> None:
    """Receive every form of command, not ``joint_command`` alone."""
    client.listen("joint_trajectory", JointTrajectory)
    client.listen("position_commands", Float64MultiArray)


def assert_all_numbers_finite(client: Client) -> None:
    """No topic carried a NaN or an infinity."""
    for message in client.received["joint_command"]:
        assert np.isfinite(message.position).all()
    for message in client.received["accepted_target"]:
        assert np.isfinite(checked_pose(pose_to_array(message.pose))).all()
    for message in client.received.get("position_commands", ()):
        assert np.isfinite(message.data).all()
    for message in client.received.get("joint_trajectory", ()):
        for point in message.points:
            assert np.isfinite(point.positions).all()


def wait_for_pairs(client: Client) -> None:
    """Wait until each accepted target that has arrived has its command, and each command its."""
    client.wait_until(
        lambda: set(client.stamps("joint_command")) == set(client.stamps("accepted_target")),
        "a command for each accepted target, and the other way round",
    )


def assert_every_command_belongs_to_a_target(
    client: Client, targets: Iterable[FloatArray], robot: Robot | None = None
) -> None:
    """Commands and accepted targets pair by stamp, lead where they should, and were asked for.

    Args:
        client: what received them.
        targets: all good targets that were sent.
        robot: the robot of the model that is served; by default the packaged one's.
    """
    robot = robot or gantry_robot()
    wait_for_pairs(client)
    assert_all_numbers_finite(client)
    stamps = client.stamps("joint_command")
    assert len(stamps) == len(set(stamps))
    commands = dict(zip(stamps, client.received["joint_command"], strict=True))
    # What the client closes its contact with differs from the first in the last bit.
    contact = good_target(0)
    contact[0] = np.nextafter(contact[0], np.inf)
    sent = {tuple(target[:3]) for target in (good_target(0), contact, *CONTACTS, *targets)}
    for stamp, message in zip(
        client.stamps("accepted_target"), client.received["accepted_target"], strict=True
    ):
        target = checked_pose(pose_to_array(message.pose))
        assert tuple(target[:3]) in sent, f"{target} was never sent as a good target"
        command = commands[stamp]
        assert tuple(command.name) == robot.joint_names
        reached = robot.forward_kinematics.poses(np.array([command.position]))[0]
        assert np.linalg.norm(reached[:3] - target[:3]) < LARGEST_ERROR


def path_message(poses: Iterable[FloatArray], frame_id: str = "") -> PoseArray:
    """The message of a path."""
    message = PoseArray(poses=[pose_from_array(pose) for pose in poses])
    message.header.frame_id = frame_id
    return message
