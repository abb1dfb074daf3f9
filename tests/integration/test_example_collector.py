"""The collector and an imperfect fake robot as processes: what is measured, and what is kept."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from support.client import reported_keys
from support.collection_plans import small_plan
from support.processes import PATIENCE, wait_until

from annik_core.dataset import MEASURED, Dataset, load_dataset, save_dataset
from annik_core.pose import pose_distance
from annik_core.robots.library import load_robot
from annik_core.simulation.fake_robot import FakeRobot
from annik_core.simulation.imperfections import ImperfectionMagnitudes, random_imperfections
from docs.diagnostic_values import DIAGNOSTIC_VALUES
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import pose_stamped_from_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds
from msg_tools.topics import TOPICS

EXAMPLES = 7
SEED = 5
#: Without noise and play the measured pose depends on the joint positions alone.
NOISELESS = {"position_noise": 0.0, "orientation_noise": 0.0, "backlash": 0.0}
#: A fake robot is as quick as it is told to be; a loaded machine is slow to say so.
QUICK = {
    "max_joint_velocity": 8.0,
    "max_joint_acceleration": 100.0,
    "max_measured_step": 20.0,
    "measurement_timeout": PATIENCE,
    "settle_timeout": PATIENCE,
    "pose_timeout": PATIENCE,
    "wait_timeout": PATIENCE,
    "settle_time": 0.05,
    "samples": 4,
}


@pytest.fixture(scope="module")
def plan() -> Dataset:
    return small_plan(load_robot("ur5e"), EXAMPLES)


@pytest.fixture
def plan_file(plan: Dataset, tmp_path: Path) -> Path:
    save_dataset(plan, tmp_path / "plan.npz")
    return tmp_path / "plan.npz"


@pytest.fixture
def start_robot(launch: Callable[..., Any]) -> Callable[..., Any]:
    """Start an imperfect fake robot with a tracker: ``start_robot(**parameters)``."""

    def start(**parameters: object) -> Any:
        given = {
            "robot": "ur5e",
            "imperfection_seed": SEED,
            "measurement_rate": 200.0,
            **NOISELESS,
            **parameters,
        }
        return launch("fake_robot", *_arguments(given))

    return start


@pytest.fixture
def start_collector(launch: Callable[..., Any], plan_file: Path) -> Callable[..., Any]:
    """Start a collector: ``start_collector(dataset, **parameters)``."""

    def start(dataset: Path, ready: bool = True, **parameters: object) -> Any:
        given = {"plan": plan_file, "dataset": dataset, **QUICK, **parameters}
        return launch("example_collector", *_arguments(given), ready=ready)

    return start


def _arguments(parameters: dict[str, object]) -> list[str]:
    return [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]


def _measured(dataset: Path) -> int:
    """How many examples are in the journal."""
    journal = dataset.with_suffix(".journal.jsonl")
    return max(journal.read_bytes().count(b"\n") - 1, 0) if journal.exists() else 0


def _wait_for_examples(node: Any, dataset: Path, count: int) -> None:
    wait_until(
        lambda: _measured(dataset) >= count or not node.is_running, f"{count} examples measured"
    )
    assert _measured(dataset) >= count, node.log


def _fatal(node: Any) -> str:
    assert node.wait_for_exit() == 1, node.log
    assert "Traceback" not in node.log
    (fatal,) = [line for line in node.log.splitlines() if "[FATAL]" in line]
    return fatal


def test_a_plan_is_measured_on_a_robot_that_is_not_as_described(
    start_robot: Callable[..., Any],
    start_collector: Callable[..., Any],
    plan: Dataset,
    tmp_path: Path,
) -> None:
    """The dataset has the poses that the robot really takes up, and how noisy they are."""
    noise = {"position_noise": 1e-4, "orientation_noise": 1e-3}
    start_robot(**noise, dropped_measurements=0.1)
    collector = start_collector(tmp_path / "measured.npz", samples=10)
    assert collector.wait_for_exit() == 0, collector.log
    assert f"{EXAMPLES} of {EXAMPLES} examples: row" in collector.log
    assert f"wrote {EXAMPLES} of {EXAMPLES} examples" in collector.log

    dataset = load_dataset(tmp_path / "measured.npz")
    assert (dataset.joint_positions == plan.joint_positions).all()
    assert dataset.source == MEASURED
    magnitudes = ImperfectionMagnitudes(**{**NOISELESS, **noise})
    real = FakeRobot(plan.robot, random_imperfections(plan.robot, SEED, magnitudes))
    poses = np.array([real.move_to(positions) for positions in plan.joint_positions])
    distances, angles = pose_distance(poses, dataset.poses)
    assert dataset.measurement_noise is not None
    expected = (1e-4 / np.sqrt(10), 1e-3 / np.sqrt(10))
    assert dataset.measurement_noise == pytest.approx(expected, rel=0.4)
    assert distances.max() < 6 * expected[0]
    assert angles.max() < 6 * expected[1]
    # Far from where it should be.
    assert pose_distance(plan.poses, dataset.poses)[0].min() > 1e-4


@pytest.mark.slow
def test_a_collector_that_is_killed_goes_on_and_ends_with_the_same_dataset(
    start_robot: Callable[..., Any], start_collector: Callable[..., Any], tmp_path: Path
) -> None:
    """To the last bit, after three kills; no example is measured twice."""
    start_robot()
    whole = tmp_path / "whole.npz"
    assert start_collector(whole).wait_for_exit() == 0

    killed = tmp_path / "killed.npz"
    moments = np.random.default_rng().uniform(0.0, 0.4, 3)
    print("killed after", moments)
    for count, moment in enumerate(moments, start=1):
        collector = start_collector(killed)
        before = _measured(killed)
        _wait_for_examples(collector, killed, max(before, count))
        time.sleep(moment)
        collector.kill()
    collector = start_collector(killed)
    assert collector.wait_for_exit() == 0, collector.log
    assert killed.read_bytes() == whole.read_bytes()
    rows = [line.split("row ")[1].split()[0] for line in _journal_log(tmp_path)]
    assert len(rows) == len(set(rows))


def _journal_log(folder: Path) -> list[str]:
    """The lines of progress of all collectors of the second dataset."""
    logs = sorted(folder.glob("*_example_collector.log"))[1:]
    return [
        line for log in logs for line in log.read_text().splitlines() if "examples: row" in line
    ]


def test_a_silent_robot_ends_the_collection_and_a_new_start_goes_on(
    start_robot: Callable[..., Any],
    start_collector: Callable[..., Any],
    plan: Dataset,
    tmp_path: Path,
) -> None:
    robot = start_robot()
    measured = tmp_path / "measured.npz"
    collector = start_collector(measured, measurement_timeout=3.0)
    _wait_for_examples(collector, measured, 2)
    robot.kill()
    fatal = _fatal(collector)
    assert "stopped: no joint states for 3" in fatal
    assert "the same command continues from there" in fatal
    kept = _measured(measured)
    assert 2 <= kept < EXAMPLES
    assert len(load_dataset(measured)) == kept

    start_robot()
    again = start_collector(measured)
    assert f"{kept} of {EXAMPLES} examples of robot ur5e are measured" in again.log
    assert again.wait_for_exit() == 0, again.log
    assert (load_dataset(measured).joint_positions == plan.joint_positions).all()


class _Drivers:
    """Pass the joint states of a fake robot on in two parts, between messages of a gripper."""

    def __init__(self, client: Any, grippers: int) -> None:
        self.parts = [slice(0, 3), slice(3, 6)]
        self._grippers = grippers
        self._publisher = client.node.create_publisher(
            JointState, "joint_states", QoSProfile(depth=1000)
        )
        client.node.create_subscription(
            JointState, "whole_joint_states", self._pass_on, QoSProfile(depth=1)
        )

    def _pass_on(self, message: JointState) -> None:
        for part in self.parts:
            names, positions = message.name[part], message.position[part].tolist()
            self._publisher.publish(JointState(name=names, position=positions))
            for _ in range(self._grippers):
                self._publisher.publish(JointState(name=["finger_joint"], position=[0.02]))


def _robot_in_parts(launch: Callable[..., Any]) -> None:
    given = {"robot": "ur5e", "imperfection_seed": SEED, "measurement_rate": 50.0, **NOISELESS}
    launch("fake_robot", *_arguments(given), "-r", "joint_states:=whole_joint_states")


def test_joint_states_in_parts_beside_a_busy_gripper_are_a_whole_robot(
    launch: Callable[..., Any],
    start_collector: Callable[..., Any],
    client: Any,
    plan: Dataset,
    tmp_path: Path,
) -> None:
    _robot_in_parts(launch)
    _Drivers(client, grippers=10)
    collector = start_collector(tmp_path / "measured.npz")
    client.wait_until(lambda: not collector.is_running, "the collector ends")
    assert collector.wait_for_exit() == 0, collector.log
    assert (load_dataset(tmp_path / "measured.npz").joint_positions == plan.joint_positions).all()
    assert "/joint_states: " not in collector.log


def test_a_part_of_the_joints_that_falls_silent_ends_the_collection(
    launch: Callable[..., Any], start_collector: Callable[..., Any], client: Any, tmp_path: Path
) -> None:
    """Naming the first of them, though others are reported and a gripper is busy."""
    _robot_in_parts(launch)
    drivers = _Drivers(client, grippers=10)
    measured = tmp_path / "measured.npz"
    collector = start_collector(measured, measurement_timeout=3.0)
    client.wait_until(
        lambda: _measured(measured) >= 2 or not collector.is_running, "two examples measured"
    )
    drivers.parts = [slice(0, 3)]
    client.wait_until(lambda: not collector.is_running, "the collector ends")
    fatal = _fatal(collector)
    assert "stopped: no joint states for 3" in fatal
    assert "wrist_1_joint was measured" in fatal
    assert 2 <= len(load_dataset(measured)) < EXAMPLES


def test_joint_states_of_other_names_are_said_once_and_when_it_gives_up(
    start_collector: Callable[..., Any], client: Any, plan: Dataset, tmp_path: Path
) -> None:
    states = client.node.create_publisher(JointState, "joint_states", QoSProfile(depth=10))
    names = [f"left_{name}" for name in plan.robot.joint_names]
    message = JointState(name=names, position=[0.0] * 6)
    client.node.create_timer(0.02, lambda: states.publish(message))
    # The shorter wait may be over before a busy machine has discovered the publisher.
    for wait_timeout in (10.0, 90.0):
        collector = start_collector(
            tmp_path / "measured.npz", wait_timeout=wait_timeout, measurement_timeout=0.5
        )
        client.wait_until(
            lambda running=collector: not running.is_running, "the collector gives up"
        )
        if "/joint_states: " in collector.log:
            break
    assert "with the prefix 'left_'" in _fatal(collector)
    (warning,) = [line for line in collector.log.splitlines() if "/joint_states: " in line]
    assert "with the prefix 'left_'" in warning


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_what_there_is(
    start_robot: Callable[..., Any],
    start_collector: Callable[..., Any],
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    # So many that it is far from done, however late the signal is sent.
    plan = small_plan(load_robot("ur5e"), 200)
    save_dataset(plan, tmp_path / "long.npz")
    start_robot()
    measured = tmp_path / "measured.npz"
    collector = start_collector(measured, plan=tmp_path / "long.npz")
    _wait_for_examples(collector, measured, 2)
    collector.signal(number)
    assert collector.wait_for_exit() == 0
    assert "Traceback" not in collector.log
    dataset = load_dataset(measured)
    assert len(dataset) == _measured(measured) < len(plan)
    assert f"wrote {len(dataset)} of {len(plan)} examples to {measured}" in collector.log
    rows = [
        np.abs(plan.joint_positions - row).max(axis=1).argmin() for row in dataset.joint_positions
    ]
    assert rows == sorted(rows)
    assert (plan.joint_positions[rows] == dataset.joint_positions).all()


def test_examples_that_can_not_be_measured_are_reported_and_the_others_kept(
    start_robot: Callable[..., Any],
    start_collector: Callable[..., Any],
    plan: Dataset,
    tmp_path: Path,
) -> None:
    """Those further from the description than allowed."""
    robot = FakeRobot(
        plan.robot,
        random_imperfections(plan.robot, SEED, ImperfectionMagnitudes(**NOISELESS)),
    )
    poses = np.array([robot.move_to(positions) for positions in plan.joint_positions])
    deviations = np.sort(pose_distance(plan.poses, poses)[0])
    start_robot()
    measured = tmp_path / "measured.npz"
    collector = start_collector(
        measured,
        max_position_deviation=float(deviations[-3:-1].mean()),
        max_repeats=0,
        max_retries=1,
    )
    fatal = _fatal(collector)
    assert "2 examples could not be measured (row" in fatal
    assert "from the nominal forward kinematics" in fatal
    assert len(load_dataset(measured)) == EXAMPLES - 2


def test_a_journal_in_use_or_of_another_plan_is_refused(
    start_collector: Callable[..., Any], plan: Dataset, tmp_path: Path
) -> None:
    measured = tmp_path / "measured.npz"
    first = start_collector(measured)
    assert "is in use by another" in _fatal(start_collector(measured, ready=False))
    first.signal(signal.SIGINT)
    assert first.wait_for_exit() == 0
    assert "nothing was measured" in first.log
    assert not measured.exists()

    with_journal = tmp_path / "other.npz"
    (tmp_path / "other.journal.jsonl").write_text('{"a": 1}\n')
    assert "line 1: it is damaged" in _fatal(start_collector(with_journal, ready=False))


def test_without_robot_and_tracker_it_gives_up_and_says_what_is_missing(
    start_collector: Callable[..., Any], tmp_path: Path
) -> None:
    fatal = _fatal(start_collector(tmp_path / "measured.npz", ready=False, wait_timeout=0.5))
    for what in ("/joint_states that has shoulder_pan_joint", "/measured_pose", "/joint_command"):
        assert what in fatal


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"plan": "''"}, "plan is ''"),
        ({"plan": "nowhere.npz"}, "nowhere.npz: no such file"),
        ({"samples": 0}, "samples is 0"),
        ({"workspace_box_lower": "[1.0,1.0,1.0]", "workspace_box_upper": "[0.0,2.0,2.0]"}, "less"),
    ],
)
def test_wrong_parameters_are_one_line_and_exit_code_1(
    start_collector: Callable[..., Any],
    tmp_path: Path,
    parameters: dict[str, object],
    complaint: str,
) -> None:
    fatal = _fatal(start_collector(tmp_path / "measured.npz", ready=False, **parameters))
    assert complaint in fatal
    assert not list(tmp_path.glob("measured*"))


def test_the_plan_is_not_overwritten(start_collector: Callable[..., Any], plan_file: Path) -> None:
    before = plan_file.read_bytes()
    assert "another file than the plan" in _fatal(start_collector(plan_file, ready=False))
    assert plan_file.read_bytes() == before


def test_poses_of_no_use_are_refused_and_counted_and_all_is_reported_as_documented(
    start_collector: Callable[..., Any], client: Any, plan: Dataset, tmp_path: Path
) -> None:
    """No command goes out before there is a pose in the base frame."""
    start_collector(tmp_path / "measured.npz")
    robot, many = plan.robot, QoSProfile(depth=10)
    poses = client.node.create_publisher(PoseStamped, "measured_pose", many)
    states = client.node.create_publisher(JointState, "joint_states", many)
    stamps = iter(range(1, 10**9))

    def publish(frame: str, pose: np.ndarray, stamp: int | None = None) -> None:
        now = stamp_from_nanoseconds(next(stamps) if stamp is None else stamp)
        centre = robot.joint_box.centre
        states.publish(joint_state_from_array(centre, robot.joint_names, now))
        # A name without a position.
        states.publish(JointState(name=robot.joint_names, position=[0.0]))
        poses.publish(pose_stamped_from_array(pose, now, frame))

    def refused(reason: str) -> Callable[[dict[str, str]], bool]:
        return lambda values: f"refused: {reason}" in values

    for reason, frame, pose, stamp in (
        ("wrong frame", "camera", plan.poses[0], None),
        ("not finite", robot.base_frame, plan.poses[0] * np.nan, None),
        ("not a unit quaternion", "", plan.poses[0] * 2.0, None),
    ):
        client.received["/diagnostics"].clear()
        client.wait_until(
            lambda reason=reason, frame=frame, pose=pose, stamp=stamp: (
                publish(frame, pose, stamp),
                client._meets("example_collector", refused(reason)),
            )[1],
            reason,
        )
    assert not client.received["joint_command"]
    client.wait_until(
        lambda: (
            publish(robot.base_frame, plan.poses[0], 10**9),
            client._meets("example_collector", refused("repeated stamp")),
        )[1],
        "a repeated stamp",
    )
    _, values = client.status("example_collector")
    assert reported_keys(values) == set(DIAGNOSTIC_VALUES["example_collector"])

    documented = {f"/{topic.name.lstrip('/')}": topic.type for topic in TOPICS}

    def used() -> dict[str, str]:
        return {
            name: kind
            for name, kind in client.topics_of("example_collector").items()
            if name not in ("/rosout", "/parameter_events")
        }

    expected = {"/joint_command", "/joint_states", "/measured_pose"}
    client.wait_until(lambda: expected <= set(used()), "the collector's topics")
    assert used().items() <= documented.items()


def test_others_who_command_the_robot_are_warned_of_where_topics_are_remapped_too(
    launch: Callable[..., Any], client: Any, plan_file: Path, tmp_path: Path
) -> None:
    remapped = ("-r", "joint_command:=arm_command")
    client.node.create_publisher(JointState, "arm_command", 1)
    given = {"plan": plan_file, "dataset": tmp_path / "measured.npz", **QUICK}
    collector = launch("example_collector", *_arguments(given), *remapped)
    # It looks for others once there is a robot; by then they have met.
    client.wait_until(
        lambda: client.node.count_publishers("arm_command") == 2, "the collector's publisher"
    )
    robot = {"robot": "ur5e", "imperfection_seed": SEED, "measurement_rate": 200.0}
    launch("fake_robot", *_arguments({**robot, **NOISELESS}), *remapped)
    assert collector.wait_for_exit() == 0, collector.log
    assert "others publish /arm_command too" in collector.log
