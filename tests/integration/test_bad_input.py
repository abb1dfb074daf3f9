"""What the running nodes must refuse: each is named, counted, and nothing is commanded for it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState

from annik_core.installation import default_model_path
from annik_core.pose import FloatArray, pose_from_roll_pitch_yaw
from annik_core.robots.library import load_robot
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds

GOOD = pose_from_roll_pitch_yaw([0.3001, 0.4, 0.6], [0.5, 0.4, 0.3])
UNREACHABLE = pose_from_roll_pitch_yaw([2.0, 0.4, 0.6], [0.5, 0.4, 0.3])


def _good(number: int) -> FloatArray:
    """A target within reach, whose x tells it from the others."""
    return GOOD + np.array([1e-3 * (number + 1), 0, 0, 0, 0, 0, 0])


def _with(index: int, value: float) -> FloatArray:
    pose = GOOD.copy()
    pose[index] = value
    return pose


def _with_norm(norm: float) -> FloatArray:
    return np.concatenate([GOOD[:3], norm * GOOD[3:]])


BAD_POSES = [
    *[(_with(index, value), "not finite") for index in range(7) for value in (math.nan, math.inf)],
    (_with(0, -math.inf), "not finite"),
    (_with_norm(0.0), "not a unit quaternion"),
    (_with_norm(1.1), "not a unit quaternion"),
    (_with_norm(1e200), "not a unit quaternion"),
    (UNREACHABLE, "outside workspace"),
    (_with(0, 1e308), "outside workspace"),
]


@pytest.mark.parametrize("stamped", [False, True])
def test_every_bad_target_is_refused_and_counted_and_the_next_good_one_answered(
    launch: Callable[..., Any], client: Any, stamped: bool
) -> None:
    """On both topics: no command, the count of its reason, and then a command for the good one."""
    launch("ik_node", "-p", "queue_depth:=1000")
    client.connect(GOOD)

    def send(pose: FloatArray) -> None:
        client.send_stamped(pose, "base_link") if stamped else client.send(pose)

    expected: dict[str, int] = {}
    contacts = len(client.received["joint_command"])
    for number, (pose, reason) in enumerate(BAD_POSES):
        send(pose)
        send(_good(number))
        # Targets of one topic are answered in order: the bad one is dealt with when this arrives.
        client.wait_for_results(_good(number), ["joint_command"])
        expected[reason] = expected.get(reason, 0) + 1
    assert len(client.received["joint_command"]) - contacts == len(BAD_POSES)
    for message in client.received["joint_command"]:
        assert np.isfinite(message.position).all()
    _, values = client.wait_for_status(
        "ik_node",
        lambda values: int(values["targets refused"]) == len(BAD_POSES),
        f"{len(BAD_POSES)} refused targets",
    )
    for reason, count in expected.items():
        assert int(values[f"refused: {reason}"]) == count
    assert int(values["targets received"]) == (
        int(values["targets accepted"]) + int(values["targets refused"])
    )
    assert float(values["solve time p50 [us]"]) > 0
    assert values["robot"] == "gantry"


@pytest.mark.parametrize(
    ("pose", "frame_id", "reason", "explanation"),
    [
        (_with(1, math.nan), "", "not finite", "position.y is nan"),
        (_with_norm(0.0), "", "not a unit quaternion", "quaternion norm is 0"),
        (_with_norm(1.1), "", "not a unit quaternion", "quaternion norm is 1.1"),
        (UNREACHABLE, "", "outside workspace", "x is 2 m"),
        (GOOD, "camera", "wrong frame", "'camera'; it must be in 'base_link'"),
        (GOOD, "/base_link", "wrong frame", "'/base_link'; it must be in 'base_link'"),
    ],
)
def test_a_refusal_is_logged_and_reported_with_its_reason(
    launch: Callable[..., Any],
    client: Any,
    pose: FloatArray,
    frame_id: str,
    reason: str,
    explanation: str,
) -> None:
    """One warning that names what is wrong, and a diagnostic level that shows it."""
    node = launch("ik_node")
    client.send_stamped(pose, frame_id)
    node.wait_for_text(explanation)
    warning = next(line for line in node.log.splitlines() if explanation in line)
    assert "WARN" in warning
    assert f"target refused, {reason}" in warning
    client.wait_until(
        lambda: any(
            status.level == DiagnosticStatus.WARN and explanation in status.message
            for message in client.received["/diagnostics"]
            for status in message.status
        ),
        "a diagnostic warning",
    )
    _, values = client.wait_for_status(
        "ik_node", lambda values: values["targets received"] == "1", "one target"
    )
    assert values[f"refused: {reason}"] == "1"
    assert explanation in values["last refusal"]
    assert not client.received["joint_command"]
    assert not client.received["accepted_target"]


def test_warnings_are_throttled(launch: Callable[..., Any], client: Any) -> None:
    """A thousand bad targets do not make a thousand lines."""
    node = launch("ik_node", "-p", "queue_depth:=1000")
    start = time.monotonic()
    for _ in range(1000):
        client.send(UNREACHABLE)
    client.wait_for_status(
        "ik_node", lambda values: values["targets refused"] == "1000", "1000 refused"
    )
    assert 1 <= node.log.count("target refused") <= 2 + (time.monotonic() - start)


def test_a_step_beyond_the_limit_is_refused_until_the_limit_is_changed(
    launch: Callable[..., Any], client: Any
) -> None:
    """The step is measured from the last accepted command, not from the refused one."""
    node = launch("ik_node", "-p", "max_joint_step:=0.01", "-p", "queue_depth:=100")
    client.connect(GOOD)
    far = GOOD + np.array([0.05, 0, 0, 0, 0, 0, 0])
    client.send(far)
    node.wait_for_text("x_drive_joint would step by")
    client.send(_good(0))
    client.wait_for_results(_good(0), ["joint_command"])
    assert not client.stamps_of(far)


def _unusable_models(folder: Path) -> dict[str, Path]:
    model = default_model_path().read_bytes()
    contents = {
        "truncated.onnx": model[: len(model) // 2],
        "text.onnx": b"this is not ONNX\n",
        "empty.onnx": b"",
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    (folder / "folder.onnx").mkdir()
    return {
        "missing": folder / "missing.onnx",
        "truncated": folder / "truncated.onnx",
        "not ONNX": folder / "text.onnx",
        "empty": folder / "empty.onnx",
        "a folder": folder / "folder.onnx",
    }


@pytest.mark.parametrize("fault", ["missing", "truncated", "not ONNX", "empty", "a folder"])
@pytest.mark.parametrize("module", ["ik_node", "fake_robot"])
def test_a_node_does_not_start_with_an_unusable_model(
    launch: Callable[..., Any], tmp_path: Path, module: str, fault: str
) -> None:
    """One line that names the file, exit code 1, no traceback."""
    path = _unusable_models(tmp_path)[fault]
    node = launch(module, "-p", f"model:={path}", ready=False)
    assert node.wait_for_exit() == 1
    _assert_one_fatal_line(node.log, str(path))


@pytest.mark.parametrize(
    ("module", "arguments", "text"),
    [
        ("ik_node", ["-p", "max_position_residual:=0.0"], "max_position_residual is 0"),
        ("ik_node", ["-p", "max_orientation_residual:=-1.0"], "max_orientation_residual is -1"),
        ("ik_node", ["-p", "max_joint_step:=.nan"], "max_joint_step is nan"),
        ("ik_node", ["-p", "queue_depth:=0"], "queue_depth is 0"),
        ("ik_node", ["-p", "queue_depth:=1.5"], "queue_depth is 1.5"),
        ("ik_node", ["-p", "model:=5"], "model is 5"),
        ("ik_node", ["-p", "model"], "model"),
        ("fake_robot", ["-p", "robot:=octopus"], "no robot 'octopus'"),
        ("target_publisher", ["-p", "rate:=0"], "rate is 0"),
        ("target_publisher", ["-p", "path:=spiral"], "one of diagonal, line, circle, csv"),
        ("target_publisher", ["-p", "circle_centre:=[1.0]"], "3 finite numbers [m]"),
        ("target_publisher", ["-p", "path:=csv"], "csv_file"),
        ("target_publisher", ["-p", "wait_timeout:=0.2"], "0 of 1 subscribers on /target_pose"),
    ],
)
def test_a_bad_parameter_ends_the_node_with_one_clear_line(
    launch: Callable[..., Any], module: str, arguments: list[str], text: str
) -> None:
    """Exit code 1, the parameter, its value and what is allowed; no traceback."""
    node = launch(module, *arguments, ready=False)
    assert node.wait_for_exit() == 1
    _assert_one_fatal_line(node.log, text)


def _assert_one_fatal_line(log: str, text: str) -> None:
    fatal = [line for line in log.splitlines() if "[FATAL]" in line]
    assert len(fatal) == 1, log
    assert text in fatal[0]
    assert "Traceback" not in log


def test_numbers_may_be_written_without_a_decimal_point(launch: Callable[..., Any]) -> None:
    """An integer is taken for the double that it means."""
    publisher = launch(
        "target_publisher",
        *("-p", "wait_for_subscribers:=0", "-p", "rate:=100"),
        *("-p", "path:=line", "-p", "line_from_position:=[0, 0, 0]"),
        ready=False,
    )
    assert publisher.wait_for_exit() == 0
    assert "published 15 targets" in publisher.log


def _robot_listens(client: Any) -> bool:
    # The client subscribes to both topics too.
    publishers = (client.command, client.accepted_target)
    return all(publisher.get_subscription_count() >= 2 for publisher in publishers)


def _command(names: tuple[str, ...], positions: list[float], stamp: int) -> JointState:
    return joint_state_from_array(positions, names, stamp_from_nanoseconds(stamp))


def test_the_fake_robot_refuses_bad_commands_and_stays_where_it_was(
    launch: Callable[..., Any], client: Any
) -> None:
    """Each is named, counted, and gives no joint state; shuffled and extra joints are fine."""
    robot = load_robot("gantry")
    names, middle = robot.joint_names, robot.joint_box.centre.tolist()
    node = launch("fake_robot", "-p", "joint_state_rate:=0.0")
    client.wait_until(lambda: _robot_listens(client), "the robot")
    unequal = JointState(name=list(names), position=middle[:5])
    bad = [
        (unequal, "malformed", "6 names but 5 positions"),
        (_command((*names, names[0]), [*middle, 0.5], 1), "malformed", "named more than once"),
        (_command(names[1:], middle[1:], 2), "missing joint", "lacks x_drive_joint"),
        (_command(("a", "b"), [0.5, 0.5], 3), "missing joint", "lacks x_drive_joint"),
        (_command(names, [*middle[:5], math.nan], 4), "not finite", "yaw_drive_joint is nan"),
        (_command(names, [*middle[:5], 9.0], 5), "joint limit", "yaw_drive_joint would be 9"),
    ]
    for message, _, _ in bad:
        client.command.publish(message)
    good = _command((*reversed(names), "gripper"), [*reversed(middle), math.nan], 77)

    client.repeat_until(
        lambda: client.command.publish(good),
        lambda: client.received["joint_states"],
        "an answer to the good command",
    )
    assert set(client.stamps("joint_states")) == {77}
    assert list(client.received["joint_states"][0].name) == list(names)
    assert list(client.received["joint_states"][0].position) == middle
    _, values = client.wait_for_status(
        "fake_robot", lambda values: values["commands refused"] == "6", "6 refused commands"
    )
    for reason in ("malformed", "missing joint", "not finite", "joint limit"):
        assert int(values[f"refused: {reason}"]) == [row[1] for row in bad].count(reason)
    assert int(values["commands received"]) == int(values["commands accepted"]) + 6
    assert "command refused: joint state: 6 names but 5 positions" in node.log
    # Refused one at a time, each is named in the log; together, the first speaks for all.
    for message, _, text in bad[2:]:
        client.repeat_until(
            lambda message=message: client.command.publish(message),
            lambda text=text: text in node.log,
            text,
        )


@pytest.mark.parametrize("topic", ["command", "accepted_target"])
@pytest.mark.parametrize(("seconds", "nanosec"), [(2**31 - 1, 4_000_000_000), (1, 10**9)])
def test_a_stamp_that_is_none_is_refused_and_the_fake_robot_goes_on(
    launch: Callable[..., Any], client: Any, topic: str, seconds: int, nanosec: int
) -> None:
    """On either topic: counted, named in the log, and the next pair is measured."""
    robot = load_robot("gantry")
    middle = robot.joint_box.centre
    pose = robot.forward_kinematics.poses(middle[np.newaxis])[0]
    node = launch("fake_robot", "-p", "joint_state_rate:=0.0")
    client.wait_until(lambda: _robot_listens(client), "the robot")
    messages = {
        "command": _command(robot.joint_names, middle.tolist(), 1),
        "accepted_target": client.pose_stamped(pose, 1, "base_link"),
    }
    stamp = messages[topic].header.stamp
    stamp.sec, stamp.nanosec = seconds, nanosec
    getattr(client, topic).publish(messages[topic])
    node.wait_for_text(f"header.stamp.nanosec is {nanosec}")
    counted = {
        "command": "refused: malformed stamp",
        "accepted_target": "accepted targets ignored",
    }[topic]
    client.wait_for_status("fake_robot", lambda values: values.get(counted) == "1", counted)

    def publish_a_good_pair() -> None:
        client.accepted_target.publish(client.pose_stamped(pose, 2, "base_link"))
        client.command.publish(_command(robot.joint_names, middle.tolist(), 2))

    client.repeat_until(
        publish_a_good_pair,
        lambda: 2 in client.stamps("tracking_error/position"),
        "the error of a good pair",
    )
    assert set(client.stamps("joint_states")) == {2}
    assert node.is_running
    assert "Traceback" not in node.log


def test_the_fake_robot_pairs_in_either_order_and_ignores_bad_targets(
    launch: Callable[..., Any], client: Any
) -> None:
    """The target may come after its result; one that is no pose is passed over."""
    robot = load_robot("gantry")
    pose = robot.forward_kinematics.poses(robot.joint_box.centre[np.newaxis])[0]
    node = launch("fake_robot")
    client.wait_until(lambda: _robot_listens(client), "the robot")
    stamp = 0

    def answered(target_first: bool) -> bool:
        nonlocal stamp
        stamp += 1
        steps = [
            lambda: client.accepted_target.publish(client.pose_stamped(pose, stamp, "base_link")),
            lambda: client.command.publish(
                _command(robot.joint_names, robot.joint_box.centre.tolist(), stamp)
            ),
        ]
        for step in steps if target_first else reversed(steps):
            step()
            # Two topics are independent of each other: only time makes an order.
            client.take_messages(0.3)
        return stamp in client.stamps("tracking_error/orientation")

    client.accepted_target.publish(client.pose_stamped(_with(0, math.nan), 1, "base_link"))
    node.wait_for_text("accepted target ignored: position.x is nan")
    for target_first in (True, False):
        client.wait_until(
            lambda target_first=target_first: answered(target_first),
            f"a tracking error, target first: {target_first}",
        )
    for message in client.received["tracking_error/position"]:
        assert (message.vector.x, message.vector.y, message.vector.z) == (0.0, 0.0, 0.0)
