"""The numbers of a report are those of the recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from support.robot_recording import RobotRecording, pose_message, stamped_pose, stamped_vector

from msg_tools.bags.metadata import jazzy_types
from msg_tools.bags.reader import read_bag
from msg_tools.report.namespace import NamespaceError
from msg_tools.report.tracking import TrackingReport, tracking_report


def report_of(
    path: Path, *recordings: RobotRecording, namespace: str | None = None
) -> TrackingReport:
    first, *others = recordings
    for other in others:
        first.messages += other.messages
    return tracking_report(read_bag(first.write(path / "bag")), namespace)


def test_errors_and_latency_are_those_of_the_recording(tmp_path: Path) -> None:
    recording = RobotRecording(count=20)
    report = report_of(tmp_path, recording)
    assert (report.targets_sent, report.targets_answered, report.targets_refused) == (20, 20, 0)
    assert [target.number for target in report.targets] == list(range(1, 21))
    for number, target in enumerate(report.targets):
        assert target.target == tuple(recording.target(number)[:3])
        assert target.stamp_ns == recording.stamp(number)
        assert target.position_error_mm == pytest.approx(0.1, rel=1e-9)
        assert target.orientation_error_deg == pytest.approx(0.01, rel=1e-6)
        assert target.latency_us == 500.0
    assert report.position_error_mm is not None
    assert report.position_error_mm.max == pytest.approx(0.1)
    assert report.latency_us is not None
    assert report.latency_us.p99 == 500.0
    assert report.latency_clock == "sent"
    assert report.recorded_error_difference is not None
    assert max(report.recorded_error_difference) < 1e-12
    assert report.notes == ()


def test_percentiles_are_those_of_numpy(tmp_path: Path) -> None:
    recording = RobotRecording(count=40)
    rng = np.random.default_rng(3)
    for message in recording.messages:
        if message.relative_topic == "joint_command":
            message.publish_time_ns += int(rng.integers(1, 10**6))
    report = report_of(tmp_path, recording)
    latencies = [target.latency_us for target in report.targets]
    assert report.latency_us is not None
    assert report.latency_us == (*np.percentile(latencies, [50, 95, 99]), max(latencies))


def test_pairs_are_made_by_stamp_never_by_order(tmp_path: Path) -> None:
    in_order = report_of(tmp_path / "in_order", RobotRecording(count=30))
    shuffled = report_of(tmp_path / "shuffled", RobotRecording(count=30).shuffled())
    assert shuffled.targets == in_order.targets
    assert shuffled.to_dict() | {"bag": ""} == in_order.to_dict() | {"bag": ""}


def test_refused_targets_are_counted_and_do_not_shift_the_pairs(tmp_path: Path) -> None:
    recording = RobotRecording(count=10, refused=(0, 4, 5))
    recording.add_diagnostics({"not finite": 1, "outside the workspace": 2, "joint limit": 0})
    report = report_of(tmp_path, recording)
    assert (report.targets_sent, report.targets_answered, report.targets_refused) == (10, 7, 3)
    assert list(report.refusal_reasons.items()) == [
        ("outside the workspace", 2),
        ("not finite", 1),
    ]
    assert {target.latency_us for target in report.targets} == {500.0}
    assert {round(target.position_error_mm, 9) for target in report.targets} == {0.1}
    assert report.notes == ()


def test_targets_replaced_in_the_queue_are_unanswered_but_not_refused(tmp_path: Path) -> None:
    recording = RobotRecording(count=10, refused=(3, 4, 5))
    recording.add_diagnostics({"not finite": 1})
    report = report_of(tmp_path, recording)
    assert (report.targets_sent, report.targets_answered) == (10, 7)
    assert (report.targets_unanswered, report.targets_refused) == (3, 1)
    results = report.to_dict()
    assert (results["targets_unanswered"], results["targets_refused"]) == (3, 1)


def test_without_diagnostics_the_unanswered_targets_count_as_refused(tmp_path: Path) -> None:
    report = report_of(tmp_path, RobotRecording(count=10, refused=(3, 4)))
    assert (report.targets_unanswered, report.targets_refused) == (2, 2)
    assert "counted as refused" in report.notes[0]


def test_answered_is_what_has_a_command(tmp_path: Path) -> None:
    """Not what has an accepted target, of which a recorder may have kept fewer or more."""
    recording = RobotRecording(count=10)
    lost = {"accepted_target": {2, 3}, "joint_command": {5}}
    recording.messages = [
        message
        for message in recording.messages
        if not any(
            message.relative_topic == topic
            and message.content.header.stamp.nanosec
            in {recording.stamp(number) % 10**9 for number in numbers}
            for topic, numbers in lost.items()
        )
    ]
    report = report_of(tmp_path, recording)
    assert (report.targets_sent, report.targets_answered, report.targets_unanswered) == (10, 9, 1)
    assert len(report.targets) == 8
    assert any("1 accepted targets have no command" in note for note in report.notes)


def test_latency_ends_with_the_command(tmp_path: Path) -> None:
    """Not with the accepted target, which is another message, published at another time."""
    recording = RobotRecording(count=10)
    for message in recording.messages:
        if message.relative_topic == "joint_command":
            message.publish_time_ns += 70_000
            message.log_time_ns += 1_000_000
        if message.relative_topic == "accepted_target":
            message.publish_time_ns -= 200_000
    report = report_of(tmp_path, recording)
    assert [target.latency_us for target in report.targets] == [570.0] * 10


def _holding_still(
    count: int, dropped: tuple[int, ...] = (), latency_ns: int = 500_000
) -> RobotRecording:
    """The same target again and again."""
    recording = RobotRecording(count=count, refused=dropped, latency_ns=latency_ns)
    recording.target = lambda number: np.array([0.5, 0, 0, 0, 0, 0, 1.0])  # type: ignore[method-assign]
    recording.messages.clear()
    recording.__post_init__()
    return recording


def test_equal_targets_that_are_all_answered_are_matched_in_order(tmp_path: Path) -> None:
    """Also if the answers come two targets late."""
    report = report_of(tmp_path, _holding_still(30, latency_ns=25_000_000))
    assert [target.latency_us for target in report.targets] == [25_000.0] * 30
    assert report.notes == ()


def test_equal_targets_of_which_some_were_dropped_have_no_latency_that_may_be_wrong(
    tmp_path: Path,
) -> None:
    recording = _holding_still(30, dropped=(10, 20))
    recording.add_diagnostics({"not finite": 2})
    report = report_of(tmp_path, recording)
    # Up to the first that was dropped, only one sent target was there to be answered.
    assert [target.latency_us for target in report.targets] == [500.0] * 10 + [None] * 18
    (note,) = report.notes
    assert note.startswith("18 of 28 answered targets are equal to several sent ones")


def test_another_target_between_equal_ones_ends_the_doubt(tmp_path: Path) -> None:
    recording = _holding_still(30, dropped=(10,))
    for number in (15,):
        for message in recording.messages:
            sent = message.publish_time_ns - recording.stamp(number) + 100_000
            if 0 <= sent < 9_000_000 and message.relative_topic == "target_pose":
                message.content.position.y = 0.25
            if 0 <= sent < 9_000_000 and message.relative_topic == "accepted_target":
                message.content.pose.position.y = 0.25
    report = report_of(tmp_path, recording)
    expected = [500.0] * 10 + [None] * 4 + [500.0] * 15
    assert [target.latency_us for target in report.targets] == expected


def test_only_the_last_diagnostics_count(tmp_path: Path) -> None:
    recording = RobotRecording(count=10, refused=(3, 4))
    recording.add_diagnostics({"not finite": 1})
    recording.messages[-1].log_time_ns -= 10**9
    recording.add_diagnostics({"not finite": 2})
    recording.messages.reverse()
    assert report_of(tmp_path, recording).refusal_reasons == {"not finite": 2}


def test_diagnostics_that_count_otherwise_are_told(tmp_path: Path) -> None:
    recording = RobotRecording(count=10, refused=(3, 4))
    recording.add_diagnostics({"not finite": 1})
    (note,) = report_of(tmp_path, recording).notes
    assert "2 targets have no command" in note


def test_missing_diagnostics_are_told(tmp_path: Path) -> None:
    (note,) = report_of(tmp_path, RobotRecording(count=10, refused=(3,))).notes
    assert "no diagnostics" in note


@pytest.mark.parametrize("value", ["", "many", "1.5"])
def test_diagnostics_without_numbers_are_passed_over(tmp_path: Path, value: str) -> None:
    recording = RobotRecording(count=4, refused=(3,))
    recording.add_diagnostics({"not finite": 1})
    recording.messages[-1].content.status[0].values[2].value = value
    assert report_of(tmp_path, recording).refusal_reasons == {}


def test_a_path_that_repeats_its_poses_is_matched_in_order(tmp_path: Path) -> None:
    recording = RobotRecording(count=30, refused=(7, 8))
    recording.target = lambda number: np.array([number % 10, 0, 0, 0, 0, 0, 1.0])  # type: ignore[method-assign]
    recording.messages.clear()
    recording.__post_init__()
    report = report_of(tmp_path, recording)
    assert len(report.targets) == 28
    assert {target.latency_us for target in report.targets} == {500.0}


def test_targets_that_differ_in_orientation_only_are_told_apart(tmp_path: Path) -> None:
    recording = RobotRecording(count=10, refused=(2, 6))
    for message in recording.messages:
        if message.relative_topic == "target_pose":
            message.content.position.x = 0.0
        if message.relative_topic == "accepted_target":
            message.content.pose.position.x = 0.0
    for message in recording.messages:
        for pose in (
            getattr(message.content, "pose", None),
            message.content if message.relative_topic == "target_pose" else None,
        ):
            if pose is not None and message.relative_topic != "achieved_pose":
                pose.position.y = pose.position.z = 0.0
    report = report_of(tmp_path, recording)
    assert {target.latency_us for target in report.targets} == {500.0}


@pytest.mark.parametrize("factor", [1.0009, 0.9992, -1.0])
def test_a_target_with_a_quaternion_of_other_norm_or_sign_is_matched(
    tmp_path: Path, factor: float
) -> None:
    recording = RobotRecording(count=5)
    for message in recording.messages:
        if message.relative_topic == "target_pose":
            for axis in "xyzw":
                value = getattr(message.content.orientation, axis)
                setattr(message.content.orientation, axis, value * factor)
    report = report_of(tmp_path, recording)
    assert [target.latency_us for target in report.targets] == [500.0] * 5


def test_stamped_targets_count_and_are_matched(tmp_path: Path) -> None:
    recording = RobotRecording(count=6)
    for message in recording.messages:
        if message.relative_topic == "target_pose":
            message.topic = "/target_pose_stamped"
            target = message.content
            message.content = stamped_pose(1, [0, 0, 0, 0, 0, 0, 1])
            message.content.pose = target
    report = report_of(tmp_path, recording)
    assert report.targets_sent == 6
    assert [target.latency_us for target in report.targets] == [500.0] * 6


def test_nonsense_targets_are_refused_ones_and_nothing_more(tmp_path: Path) -> None:
    recording = RobotRecording(count=3)
    for pose in ([np.nan] * 7, [np.inf] * 7, [0.0] * 7, [1e308] * 7):
        recording.add("target_pose", pose_message(pose), recording.stamp(3))
    recording.add_diagnostics({"not finite": 2, "no unit quaternion": 2})
    report = report_of(tmp_path, recording)
    assert (report.targets_sent, report.targets_refused) == (7, 4)
    assert report.notes == ()


def test_a_target_sent_after_its_answer_is_not_its_cause(tmp_path: Path) -> None:
    recording = RobotRecording(count=1)
    recording.messages[0].publish_time_ns += 10**9
    report = report_of(tmp_path, recording)
    assert report.targets[0].latency_us is None
    assert report.latency_us is None
    assert "not recognised" in report.notes[0]


def test_without_publish_times_the_receive_times_serve(tmp_path: Path) -> None:
    recording = RobotRecording(count=5)
    with RosbagsWriter(
        tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3
    ) as writer:
        opened = {}
        for message in recording.messages:
            if message.topic not in opened:
                opened[message.topic] = writer.add_connection(
                    message.topic, message.type, typestore=jazzy_types()
                )
            writer.write(opened[message.topic], message.log_time_ns, message.cdr)
    report = tracking_report(read_bag(tmp_path / "bag"))
    assert report.latency_clock == "received"
    assert [target.latency_us for target in report.targets] == [500.0] * 5
    assert "received" in report.notes[-1]


@pytest.mark.parametrize(
    ("missing", "named"),
    [
        (("accepted_target",), "/accepted_target"),
        (("achieved_pose",), "/achieved_pose"),
        (("accepted_target", "achieved_pose"), "/accepted_target and /achieved_pose"),
    ],
)
def test_missing_topics_are_named(tmp_path: Path, missing: tuple[str, ...], named: str) -> None:
    report = report_of(tmp_path, RobotRecording(count=3).without(*missing))
    assert report.targets == ()
    assert report.position_error_mm is None
    assert f"no message on {named}" in report.notes[0]


def test_stamps_that_do_not_match_are_told(tmp_path: Path) -> None:
    recording = RobotRecording(count=3)
    for message in recording.messages:
        if message.relative_topic == "achieved_pose":
            message.content.header.stamp.nanosec += 1
    report = report_of(tmp_path, recording)
    assert report.targets == ()
    assert "share no stamp" in report.notes[0]


def test_an_empty_bag_has_a_report(tmp_path: Path) -> None:
    report = report_of(tmp_path, RobotRecording(count=0))
    assert report.targets_sent == 0
    assert "nothing to compare" in report.notes[0]


def test_recorded_errors_that_disagree_are_told(tmp_path: Path) -> None:
    recording = RobotRecording(count=5)
    for message in recording.messages:
        if message.relative_topic == "tracking_error/position":
            message.content.vector.y += 2e-9
    report = report_of(tmp_path, recording)
    assert report.recorded_error_difference is not None
    assert report.recorded_error_difference[0] == pytest.approx(2e-9)
    assert "disagree" in report.notes[0]


def test_a_recorded_error_that_is_no_number_disagrees(tmp_path: Path) -> None:
    recording = RobotRecording(count=2).without("tracking_error/position")
    for number in range(2):
        recording.add(
            "tracking_error/position", stamped_vector(recording.stamp(number), [np.nan] * 3), 5
        )
    report = report_of(tmp_path, recording)
    assert "disagree" in report.notes[0]
    assert report.recorded_error_difference is None


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e308, -1e200])
@pytest.mark.parametrize("topic", ["tracking_error/position", "tracking_error/orientation"])
def test_recorded_errors_that_are_no_numbers_do_not_hide_the_others(
    tmp_path: Path, topic: str, value: float
) -> None:
    recording = RobotRecording(count=5)
    next(m for m in recording.messages if m.relative_topic == topic).content.vector.y = value
    report = report_of(tmp_path, recording)
    assert report.recorded_error_difference is not None
    assert max(report.recorded_error_difference) < 1e-12
    (note,) = report.notes
    assert "1 recorded tracking errors are no numbers" in note


def test_a_bag_without_recorded_errors_says_so(tmp_path: Path) -> None:
    report = report_of(tmp_path, RobotRecording(count=2).without("tracking_error/position"))
    assert report.recorded_error_difference is None
    assert "no recorded tracking errors" in report.notes[0]


def test_a_repeated_stamp_pairs_with_nothing(tmp_path: Path) -> None:
    recording = RobotRecording(count=4)
    again = next(m for m in recording.messages if m.relative_topic == "achieved_pose")
    recording.messages.append(again)
    report = report_of(tmp_path, recording)
    assert [target.stamp_ns for target in report.targets] == [
        recording.stamp(number) for number in (1, 2, 3)
    ]
    assert any("several achieved poses" in note for note in report.notes)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e308, -1e200, 1e7])
@pytest.mark.parametrize("topic", ["achieved_pose", "accepted_target"])
def test_a_result_that_is_no_pose_is_left_out(tmp_path: Path, topic: str, value: float) -> None:
    recording = RobotRecording(count=4)
    message = next(m for m in recording.messages if m.relative_topic == topic)
    message.content.pose.position.x = value
    report = report_of(tmp_path, recording)
    assert len(report.targets) == 3
    assert any("invalid pose" in note for note in report.notes)


def test_one_namespace_is_found(tmp_path: Path) -> None:
    report = report_of(tmp_path, RobotRecording(count=3, namespace="/cell/left"))
    assert report.namespace == "/cell/left"
    assert len(report.targets) == 3


def test_several_namespaces_need_a_choice(tmp_path: Path) -> None:
    left, right = RobotRecording(count=3, namespace="/left"), RobotRecording(count=5)
    with pytest.raises(NamespaceError) as caught:
        report_of(tmp_path / "unclear", left, right)
    assert (caught.value.wanted, caught.value.namespaces) == (None, ("/", "/left"))
    for wanted, count in (("/left", 3), ("left", 3), ("/", 5), ("", 5)):
        left, right = RobotRecording(count=3, namespace="/left"), RobotRecording(count=5)
        path = tmp_path / f"chosen_{wanted.replace('/', '_')}"
        assert len(report_of(path, left, right, namespace=wanted).targets) == count
    with pytest.raises(NamespaceError) as caught:
        tracking_report(read_bag(tmp_path / "unclear" / "bag"), "middle")
    assert (caught.value.wanted, caught.value.namespaces) == ("/middle", ("/", "/left"))


def test_diagnostics_are_those_of_the_chosen_robot(tmp_path: Path) -> None:
    left = RobotRecording(count=3, namespace="/left", refused=(1,))
    right = RobotRecording(count=3, namespace="/right")
    left.add_diagnostics({"not finite": 1}, name="/left/ik_node")
    right.add_diagnostics({}, name="/right/ik_node")
    report = report_of(tmp_path, left, right, namespace="left")
    assert report.refusal_reasons == {"not finite": 1}


def test_targets_from_elsewhere_are_not_another_robot(tmp_path: Path) -> None:
    recording = RobotRecording(count=3)
    recording.add("/planner/target_pose", pose_message([0] * 6 + [1]), 1)
    assert report_of(tmp_path, recording).namespace == "/"


def test_the_damage_of_a_bag_is_in_its_report(tmp_path: Path) -> None:
    path = RobotRecording(count=30).write(tmp_path / "bag")
    (file,) = path.glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 3])
    report = tracking_report(read_bag(path))
    assert not report.bag_complete
    assert 0 < len(report.targets) < 30
    assert "cut" in report.notes[0]
