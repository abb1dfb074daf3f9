"""An imperfect arm over DDS: what it shows, and what it keeps to itself."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import load_robot
from annik_core.simulation.imperfections import JOINT_ENTRIES, random_imperfections
from msg_tools.bags.reader import read_bag
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import pose_to_array, vector3_to_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds, stamp_to_nanoseconds
from msg_tools.report.tracking import tracking_report

UR5E = load_robot("ur5e")
MIDDLE = UR5E.joint_box.centre
MIDDLE_POSE = UR5E.forward_kinematics.poses(MIDDLE[np.newaxis])[0]
ERRORS = ("tracking_error/position", "tracking_error/orientation")


def _arguments(**parameters: object) -> list[str]:
    given = {"robot": "ur5e", **parameters}
    return [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]


def _targets(count: int) -> FloatArray:
    """Poses from the middle of the working box, of the arm as described."""
    box = UR5E.joint_box
    share = np.random.default_rng(1).uniform(0.2, 0.8, (count, UR5E.dof))
    return UR5E.forward_kinematics.poses(box.lower + share * (box.upper - box.lower))


def _poses(client: Any, topic: str) -> FloatArray:
    return np.array([pose_to_array(message.pose) for message in client.received[topic]])


def _achieved(client: Any, joint_positions: FloatArray) -> FloatArray:
    """Where the arm says that a command took it, as soon as it has met the client."""
    client.received["achieved_pose"].clear()
    command = joint_state_from_array(joint_positions, UR5E.joint_names, stamp_from_nanoseconds(1))
    client.repeat_until(
        lambda: client.command.publish(command),
        lambda: client.received["achieved_pose"],
        "the achieved pose",
    )
    return _poses(client, "achieved_pose")[0]


def test_a_tracker_measures_at_its_rate_with_its_noise(
    launch: Callable[..., Any], client: Any
) -> None:
    """Without any command; joint_states come with each measurement, as the encoders have them."""
    launch("fake_robot", *_arguments(imperfection_seed=5, measurement_rate=100.0))
    client.listen("measured_pose", PoseStamped)
    client.wait_until(lambda: len(client.received["measured_pose"]) >= 400, "400 measurements")
    measured = client.received["measured_pose"]
    assert {message.header.frame_id for message in measured} == {UR5E.base_frame}
    stamps = np.array(client.stamps("measured_pose"))
    periods = 1e-9 * np.diff(stamps)
    # A loaded machine measures late now and then, and never more often.
    assert (periods > 0).all()
    assert 0.0099 < periods.mean() < 0.05
    assert np.isclose(periods, 0.01, rtol=0.1).mean() > 0.25
    poses = _poses(client, "measured_pose")
    turns = Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(poses[0, 3:]).inv()
    np.testing.assert_allclose(poses[:, :3].std(axis=0), 20e-6, rtol=0.25)
    np.testing.assert_allclose(turns.as_rotvec().std(axis=0), np.radians(0.002), rtol=0.25)
    # It is measured where it is, not where its description has it.
    distance, _ = pose_distance(MIDDLE_POSE, _achieved(client, MIDDLE))
    assert distance > 1e-3
    mean = poses[:, :3].mean(axis=0)
    np.testing.assert_allclose(mean, _poses(client, "achieved_pose")[0, :3], rtol=0, atol=5e-6)
    client.wait_until(lambda: client.stamps("joint_states")[-1] >= stamps[-1], "joint states")
    joint_stamps = client.stamps("joint_states")
    with_joint_states = stamps[stamps >= joint_stamps[0]]
    assert len(with_joint_states) > 200
    assert set(with_joint_states) <= set(joint_stamps)
    for message in client.received["joint_states"]:
        assert tuple(message.name) == UR5E.joint_names
        np.testing.assert_array_equal(message.position, MIDDLE)


def test_dropped_measurements_are_missing_and_counted(
    launch: Callable[..., Any], client: Any
) -> None:
    """The joint states come on all the same."""
    launch(
        "fake_robot",
        *_arguments(imperfection_seed=5, measurement_rate=100.0, dropped_measurements=0.5),
    )
    client.listen("measured_pose", PoseStamped)
    client.wait_until(lambda: len(client.received["measured_pose"]) >= 200, "200 measurements")
    first, *_, last = client.stamps("measured_pose")
    client.wait_until(lambda: client.stamps("joint_states")[-1] >= last, "joint states")
    joint_stamps = [stamp for stamp in client.stamps("joint_states") if first <= stamp <= last]
    measured_stamps = client.stamps("measured_pose")
    assert set(measured_stamps) >= {first, last}
    share = len(set(joint_stamps) & set(measured_stamps)) / len(joint_stamps)
    assert abs(share - 0.5) < 0.12
    _, values = client.wait_for_status(
        "fake_robot", lambda values: int(values["measurements published"]) >= 200, "counts"
    )
    dropped, published = (int(values[f"measurements {what}"]) for what in ("dropped", "published"))
    assert abs(published / (published + dropped) - 0.5) < 0.12


def test_a_seed_is_the_same_arm_after_a_restart_and_another_seed_another(
    launch: Callable[..., Any], client: Any
) -> None:
    """Millimetres from where its description has it, and from the other."""
    achieved = []
    for seed in (5, 5, 6):
        node = launch("fake_robot", *_arguments(imperfection_seed=seed))
        achieved.append(_achieved(client, MIDDLE))
        node.signal(signal.SIGINT)
        assert node.wait_for_exit() == 0
    first, again, other = achieved
    np.testing.assert_array_equal(first, again)
    for pose in (MIDDLE_POSE, other):
        distance, _ = pose_distance(pose, first)
        assert 0.5e-3 < distance < 50e-3


def test_the_tracking_error_is_what_the_description_misses_by(
    launch: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """Recorded, with measurements in between: every target pairs with its own result."""
    bag = tmp_path / "bag"
    launch("ik_node", "-p", "model:=ur5e", "-p", "queue_depth:=100", "-p", "first_command:=free")
    launch("fake_robot", *_arguments(imperfection_seed=5, measurement_rate=200.0))
    recorder = launch("bag_recorder", "-p", f"output:={bag}")
    contact, *targets = _targets(16)
    client.connect(contact, ERRORS[1])
    topics = ("accepted_target", "joint_command", "joint_states", "achieved_pose", *ERRORS)

    def recorded(stamp: int) -> bool:
        """Whether the bag has this and what comes with it."""
        stamps: dict[str, set[int]] = {f"/{topic}": set() for topic in topics}
        for record in read_bag(bag).records(stamps):
            stamps[record.topic].add(stamp_to_nanoseconds(record.message.header.stamp))
        return all(stamp in found for found in stamps.values())

    # Until the recorder has met everybody too.
    client.repeat_until(
        lambda: client.send(contact),
        lambda: any(recorded(stamp) for stamp in client.stamps_of(contact)[-2:]),
        "a target and all its results in the bag",
    )
    for target in targets:
        client.send(target)
    client.wait_for_results(targets[-1], topics)
    (last,) = client.stamps_of(targets[-1])
    client.wait_until(lambda: recorded(last), "the last target's results in the bag")
    recorder.signal(signal.SIGINT)
    assert recorder.wait_for_exit() == 0
    for target in targets:
        (stamp,) = client.stamps_of(target)
        by_stamp = {
            topic: dict(zip(client.stamps(topic), client.received[topic], strict=True))
            for topic in ("achieved_pose", ERRORS[0])
        }
        achieved = pose_to_array(by_stamp["achieved_pose"][stamp].pose)
        error = vector3_to_array(by_stamp[ERRORS[0]][stamp].vector)
        np.testing.assert_array_equal(error, target[:3] - achieved[:3])
        assert np.linalg.norm(error) > 0.5e-3
    content = read_bag(bag)
    assert "/measured_pose" in content.topics
    report = tracking_report(content)
    reported = {result.stamp_ns for result in report.targets}
    assert reported >= {stamp for target in targets for stamp in client.stamps_of(target)}
    assert report.position_error_mm is not None
    assert 0.5 < report.position_error_mm.p50 < 50.0
    assert report.recorded_error_difference is not None
    assert max(report.recorded_error_difference) < 1e-12
    assert not [note for note in report.notes if "stamps occur" in note or "disagree" in note]


def test_nothing_is_measured_unless_asked_for(launch: Callable[..., Any], client: Any) -> None:
    """And joint_states come with commands only, if asked for."""
    launch("fake_robot", *_arguments(imperfection_seed=5, joint_state_rate=0.0))
    _achieved(client, MIDDLE)
    assert "/measured_pose" not in client.topics_of("fake_robot")
    assert set(client.stamps("joint_states")) == {1}


def test_neither_log_nor_diagnostics_nor_parameters_tell_the_errors(
    launch: Callable[..., Any], client: Any
) -> None:
    """What is to be learned is not given away."""
    node = launch("fake_robot", *_arguments(imperfection_seed=5, measurement_rate=100.0))
    node.wait_for_text("imperfect fake robot ur5e")
    _achieved(client, MIDDLE)
    _, values = client.wait_for_status("fake_robot", lambda _: True, "any state")
    assert values["robot definition sha256"] == UR5E.definition_hash[:12]
    del values["robot definition sha256"]
    told = re.sub(r"\[\d+\.\d+\]", "[time]", node.log) + str(values)
    drawn = random_imperfections(UR5E, 5)
    for name in set(JOINT_ENTRIES) - {"backlash"}:
        for amount in filter(None, getattr(drawn, name)):
            digits = re.sub(r"^[0.]*", "", f"{abs(amount):.12f}")[:4]
            assert digits not in told


def test_a_file_describes_an_imperfect_arm(launch: Callable[..., Any], client: Any) -> None:
    launch("fake_robot", *_arguments(imperfections="config/imperfect_ur5e.yaml"))
    distance, _ = pose_distance(MIDDLE_POSE, _achieved(client, MIDDLE))
    assert 0.5e-3 < distance < 50e-3


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"robot": "gantry", "imperfection_seed": 1}, "only an arm can be imperfect"),
        (
            {"robot": "gantry", "imperfections": "config/imperfect_ur5e.yaml"},
            "only an arm can be imperfect",
        ),
        ({"imperfections": "{tmp}/none.yaml"}, "none.yaml: file not found"),
        ({"imperfections": "{tmp}/wrong.yaml"}, "joints.elbow_joint.joint_zero is 2; allowed: "),
        (
            {"imperfections": "config/imperfect_ur5e.yaml", "imperfection_seed": 1},
            "imperfection_seed is 1; allowed: -1",
        ),
        (
            {"joint_zero_error": 0.01},
            "joint_zero_error is 0.01; allowed: 0.00872665",
        ),
        (
            {"imperfection_seed": 1, "link_length_error": 1.0},
            "link_length_error is 1.0; allowed: a number from 0 to 0.1 [m]",
        ),
        ({"measurement_rate": -1.0}, "measurement_rate is -1.0; allowed: a number from 0"),
    ],
)
def test_what_makes_no_imperfect_arm_ends_the_node(
    launch: Callable[..., Any], tmp_path: Path, parameters: dict[str, object], complaint: str
) -> None:
    """One line that says what is wrong, exit code 1."""
    (tmp_path / "wrong.yaml").write_text(
        "joints: {elbow_joint: {joint_zero: 2}}", encoding="utf-8"
    )
    given = {
        name: value.format(tmp=tmp_path) if isinstance(value, str) else value
        for name, value in parameters.items()
    }
    node = launch("fake_robot", *_arguments(**given), ready=False)
    assert node.wait_for_exit() == 1
    (fatal,) = [line for line in node.log.splitlines() if "[FATAL]" in line]
    assert complaint in fatal
    assert "Traceback" not in node.log
