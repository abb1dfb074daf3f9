"""The collector with a simulated robot, tracker and clock: what it commands, believes and refuses.

ROS-free.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from support.collection_plans import plan_at, small_plan
from support.continuous_arm import CONTINUOUS_URDF, OPTIONS

from annik_core.collection.collector import (
    CollectionStopped,
    Collector,
    ExampleQueue,
    Phase,
    StopCause,
    duration_in_words,
)
from annik_core.collection.journal import CollectionJournal
from annik_core.collection.measurement import Settling
from annik_core.collection.motion import Approach
from annik_core.collection.settings import CollectionSettings
from annik_core.pose import pose_distance
from annik_core.robots.library import load_robot
from annik_core.serving.measured_joints import MeasuredPositions

#: Quick, for a robot that keeps up; in simulated time all the same.
SETTINGS = CollectionSettings(
    command_rate=100.0,
    max_joint_velocity=2.0,
    max_joint_acceleration=20.0,
    settle_time=0.1,
    settle_timeout=1.0,
    pose_timeout=0.5,
    samples=4,
)


class Messages:
    """What the collector said."""

    def __init__(self) -> None:
        self.infos: list[str] = []
        self.warnings: list[str] = []

    def info(self, message: str) -> None:
        self.infos.append(message)

    def warning(self, message: str) -> None:
        self.warnings.append(message)


class Simulation:
    """A robot that follows with a lag, a tracker that may err, and a clock.

    Attributes:
        now: the time [s].
        commands: every command so far, with its time.
        measure_joints: what the joint states say of the true joint positions; None: nothing.
        measure_pose: what the tracker says of the true pose, given the row; None: nothing.
    """

    def __init__(self, collector: Collector, lag: float = 0.03) -> None:
        self.collector = collector
        self.robot = collector.journal.plan.robot
        self.now = 100.0
        self.joints = self.robot.joint_box.centre.copy()
        self.commands: list[tuple[float, np.ndarray]] = []
        self.follow: Callable[[np.ndarray], np.ndarray] = lambda command: command
        self.measure_joints: Callable[[np.ndarray], np.ndarray | None] = lambda joints: joints
        self.measure_pose: Callable[[np.ndarray], np.ndarray | None] = lambda pose: pose
        self.lag = lag
        self.period = 1.0 / SETTINGS.command_rate
        self.last: MeasuredPositions | None = None

    def begin(self) -> None:
        self.listen()
        assert self.last is not None
        self.collector.begin(self.now, self.last)

    def listen(self) -> None:
        measured = self.measure_joints(self.joints)
        if measured is not None:
            self.last = MeasuredPositions(self.now, measured)

    def step(self, period: float | None = None) -> None:
        self.now += self.period if period is None else period
        self.listen()
        command = self.collector.tick(self.now, self.last)
        self.commands.append((self.now, command))
        share = 1.0 - math.exp(-self.period / self.lag)
        self.joints = self.joints + share * (self.follow(command) - self.joints)
        pose = self.measure_pose(self.robot.forward_kinematics.poses(self.joints[None])[0])
        if pose is not None:
            self.collector.on_pose(self.now, pose)

    def run(self, until: Callable[[], bool] = lambda: False, limit: float = 200.0) -> None:
        """Until the collector is done, or something is true."""
        end = self.now + limit
        while self.collector.phase is not Phase.DONE and not until():
            assert self.now < end, f"{self.collector.phase} after {limit} s"
            self.step()

    @property
    def row(self) -> int:
        visit = self.collector._visit
        assert visit is not None
        return visit.row


@pytest.fixture
def make(gantry, tmp_path):
    """Make a simulation: ``make(**settings)``; the journal goes on in the same folder."""
    journals: list[CollectionJournal] = []

    def make_simulation(plan=None, **settings) -> Simulation:
        for journal in journals:
            journal.close()
        chosen = dataclasses.replace(SETTINGS, **settings)
        journals.append(
            CollectionJournal(tmp_path / "journal.jsonl", plan or small_plan(gantry), 4)
        )
        simulation = Simulation(Collector(journals[-1], chosen, Messages()))
        simulation.period = 1.0 / chosen.command_rate
        return simulation

    yield make_simulation
    for journal in journals:
        journal.close()


def messages(simulation: Simulation) -> Messages:
    return simulation.collector._log


def test_every_example_is_measured_where_it_was_planned(make) -> None:
    simulation = make()
    simulation.begin()
    simulation.run()
    journal = simulation.collector.journal
    assert journal.is_complete
    dataset = journal.dataset()
    distances, angles = pose_distance(journal.plan.poses, dataset.poses)
    # The lag: within the settle tolerance.
    assert distances.max() < 1e-3
    assert angles.max() < SETTINGS.settle_tolerance * math.sqrt(3)
    assert not messages(simulation).warnings
    assert len(messages(simulation).infos) == 5
    assert messages(simulation).infos[-1].startswith("5 of 5 examples: row ")
    for example in journal.examples.values():
        planned = journal.plan.joint_positions[example.row]
        assert np.abs(example.joint_positions - planned).max() <= SETTINGS.settle_tolerance


def test_commands_begin_where_the_robot_is_and_never_exceed_speed_or_limits(make) -> None:
    simulation = make()
    start = simulation.joints.copy()
    began = simulation.now
    simulation.begin()
    rng = np.random.default_rng(0)
    while simulation.collector.phase is not Phase.DONE:
        # A loaded machine calls late, and then soon again.
        simulation.step(rng.choice([0.2, 1.0, 1.0, 1.0, 1.8, 30.0]) * 0.01)
    times = np.array([time for time, _ in simulation.commands])
    commands = np.array([start, *(command for _, command in simulation.commands)])
    steps = np.abs(np.diff(commands, axis=0)).max(axis=1)
    intervals = np.diff(times, prepend=began)
    assert (steps <= SETTINGS.max_joint_velocity * intervals * (1 + 1e-9) + 1e-12).all()
    # After a long pause it is no jump either.
    assert steps.max() <= 2.0 * SETTINGS.spacing * (1 + 1e-9)
    assert simulation.robot.joint_limits.contains(commands)


def test_the_same_examples_in_the_order_of_the_journal_after_any_interruption(make) -> None:
    """Nothing is measured twice, and nothing is lost."""
    simulation = make()
    simulation.begin()
    simulation.run(lambda: len(simulation.collector.journal.examples) == 2)
    order = simulation.collector.journal.order
    first = dict(simulation.collector.journal.examples)
    again = make()
    assert again.collector.journal.order == order
    # The robot was moved by hand in between.
    again.joints = again.robot.joint_box.lower.copy()
    again.begin()
    again.run()
    examples = again.collector.journal.examples
    assert tuple(examples) == order
    for row, example in first.items():
        assert (examples[row].pose == example.pose).all()


def test_a_complete_journal_leaves_nothing_to_do(make) -> None:
    simulation = make()
    simulation.begin()
    simulation.run()
    again = make()
    again.begin()
    assert again.collector.phase is Phase.DONE


def test_silent_joint_states_stop_everything(make) -> None:
    simulation = make()
    simulation.begin()
    simulation.run(lambda: simulation.collector.phase is Phase.MOVING)
    simulation.step()
    simulation.measure_joints = lambda joints: None
    since = simulation.now
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.SILENCE
    assert re.search(r"for 0\.5\d* s, .* measurement_timeout of 0\.5 s", caught.value.reason)
    assert simulation.now - since == pytest.approx(SETTINGS.measurement_timeout, abs=0.03)


def test_rare_commands_are_no_silence_of_the_robot(make) -> None:
    """Though between two of them it is longer than joint states may be silent."""
    simulation = make(command_rate=1.0, max_joint_velocity=0.05)
    assert simulation.period > SETTINGS.measurement_timeout
    simulation.begin()
    for _ in range(20):
        simulation.step()
    assert len(simulation.commands) == 20
    simulation.measure_joints = lambda joints: None
    simulation.last = None
    with pytest.raises(CollectionStopped) as caught:
        simulation.step()
    assert caught.value.cause is StopCause.SILENCE


def test_a_pause_of_the_collector_itself_is_no_silence_of_the_robot(make) -> None:
    simulation = make()
    simulation.begin()
    for _ in range(5):
        simulation.step()
    simulation.measure_joints = lambda joints: None
    simulation.step(3.0)
    simulation.measure_joints = lambda joints: joints
    simulation.run()
    assert simulation.collector.journal.is_complete


def test_a_joint_that_jumps_stops_everything(make) -> None:
    simulation = make()
    simulation.begin()
    simulation.run(lambda: simulation.collector.phase is Phase.MEASURING)
    simulation.measure_joints = lambda joints: joints + 0.3 * np.eye(6)[2]
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.JUMP
    joint = simulation.robot.joint_names[2]
    assert caught.value.reason.startswith(f"{joint} was measured at ")
    assert "max_measured_step" in str(caught.value)


class TestMerged:
    """Joint positions of several messages: their time is that of the oldest."""

    @pytest.fixture
    def simulation(self, make) -> Simulation:
        """While it measures, with joints whose oldest message is not followed by another."""
        simulation = make()
        simulation.begin()
        simulation.run(lambda: simulation.collector.phase is Phase.MEASURING)
        simulation.measure_joints = lambda joints: None
        return simulation

    def tick(self, simulation: Simulation, shift: float, fault: str | None = None) -> None:
        """One joint is measured anew; the oldest message stays."""
        last = simulation.last
        moved = last._replace(joint_positions=last.joint_positions + shift * np.eye(6)[2])
        simulation.last = moved
        simulation.now += simulation.period
        simulation.collector.tick(simulation.now, moved, fault)

    def test_a_jump_of_one_joint_is_noticed_while_another_is_silent(self, simulation) -> None:
        with pytest.raises(CollectionStopped) as caught:
            self.tick(simulation, 0.3)
        assert caught.value.cause is StopCause.JUMP

    def test_a_motion_of_one_joint_is_noticed_while_another_is_silent(self, simulation) -> None:
        self.tick(simulation, 0.01)
        self.tick(simulation, 0.0)
        assert simulation.collector.phase is Phase.SETTLING

    @pytest.mark.parametrize("shift", [0.0, 1e-5])
    def test_a_silent_joint_stops_the_collection_though_others_report(
        self, simulation, shift
    ) -> None:
        """With the reason, if there is one."""
        since = simulation.now
        with pytest.raises(CollectionStopped) as caught:
            while simulation.now < since + 2.0:
                self.tick(simulation, shift, "z_drive_joint was measured long ago")
        assert caught.value.cause is StopCause.SILENCE
        assert "z_drive_joint was measured long ago" in str(caught.value)
        assert simulation.now - since == pytest.approx(SETTINGS.measurement_timeout, abs=0.03)


class TestContinuousJoints:
    """The first joint turns without limits; most examples are around its seam."""

    @pytest.fixture
    def plan(self):
        robot = load_robot(CONTINUOUS_URDF, **OPTIONS)
        joints = small_plan(robot, 8).joint_positions.copy()
        joints[:, 0] = -3.1, 3.1, 3.0, -2.9, math.pi, -math.pi, 2.8, 0.5
        return plan_at(robot, joints)

    @pytest.mark.parametrize("turns", [-1, 0, 1])
    @pytest.mark.parametrize("wraps", [True, False])
    def test_are_moved_and_measured_the_shorter_way(self, make, plan, turns, wraps) -> None:
        """Whether or not the driver counts the turns, and wherever it begins to count."""
        simulation = make(plan, max_measured_step=0.3)

        def measured(joints: np.ndarray) -> np.ndarray:
            if not wraps:
                return joints
            return np.array([math.remainder(joints[0], 2 * math.pi), *joints[1:]])

        simulation.measure_joints = measured
        if wraps:
            simulation.follow = lambda command: plan.robot.unwrapped(command, simulation.joints)
        start = simulation.joints.copy()
        start[0] = 2.7 + 2 * math.pi * turns
        simulation.joints = start
        simulation.begin()
        began = simulation.collector.command
        assert plan.robot.difference(began, start) == pytest.approx(np.zeros(6), abs=1e-9)
        simulation.run()
        commands = np.array([began, *(command for _, command in simulation.commands)])
        steps = np.abs(np.diff(commands, axis=0)).max()
        assert steps <= 2.0 * SETTINGS.spacing * (1 + 1e-9)
        # Around the seam, and once to the other side: not a full turn for each of them.
        assert np.abs(np.diff(commands[:, 0])).sum() < 2 * math.pi
        examples = simulation.collector.journal.examples
        assert len(examples) == len(plan)
        for example in examples.values():
            planned = plan.joint_positions[example.row]
            assert np.abs(example.joint_positions - planned).max() <= SETTINGS.settle_tolerance
        assert not messages(simulation).warnings

    def test_that_jump_stop_everything(self, make, plan) -> None:
        simulation = make(plan, max_measured_step=0.3)
        simulation.begin()
        simulation.run(lambda: simulation.collector.phase is Phase.MEASURING)
        simulation.measure_joints = lambda joints: joints + 3.0 * np.eye(6)[0]
        with pytest.raises(CollectionStopped) as caught:
            simulation.run()
        assert caught.value.cause is StopCause.JUMP


def test_a_robot_that_does_not_follow_stops_everything(make) -> None:
    """Such as one that is blocked. It is not commanded to go further than the limit allows."""
    simulation = make(max_measured_step=0.05)
    simulation.begin()
    stuck = simulation.joints.copy()
    simulation.follow = lambda command: stuck
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.LAG
    assert "0.05" in caught.value.reason
    commands = np.array([command for _, command in simulation.commands])
    assert np.abs(commands - stuck).max() <= 0.05


def test_a_robot_that_goes_elsewhere_stops_everything(make) -> None:
    simulation = make(max_measured_step=0.05)
    simulation.begin()
    away = simulation.joints + 0.5
    simulation.follow = lambda command: simulation.joints + 0.05 * (away - simulation.joints)
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.WRONG_PLACE
    assert "0.05, the max_measured_step" in caught.value.reason


@pytest.mark.parametrize("late", [0.1, 0.3])
def test_joint_states_that_are_late_slow_the_motion_down_and_do_not_stop_it(make, late) -> None:
    """At full speed, what they say would be further from the command than allowed."""
    simulation = make(max_measured_step=0.15)
    assert late * SETTINGS.max_joint_velocity > 0.15
    simulation.begin()
    said = [simulation.joints] * round(late / simulation.period)

    def before(joints: np.ndarray) -> np.ndarray:
        said.append(joints)
        return said.pop(0)

    simulation.measure_joints = before
    simulation.run()
    assert simulation.collector.journal.is_complete
    assert not messages(simulation).warnings


@pytest.mark.parametrize("beyond", [0.001, 0.1])
def test_a_robot_a_little_beyond_a_limit_may_begin_and_one_far_beyond_not(make, beyond) -> None:
    simulation = make()
    simulation.joints = simulation.robot.joint_limits.upper + beyond
    if beyond > SETTINGS.settle_tolerance:
        with pytest.raises(CollectionStopped) as caught:
            simulation.begin()
        assert caught.value.cause is StopCause.OUTSIDE_LIMITS
        assert "move it away" in caught.value.reason
        assert simulation.collector.journal.order is None
    else:
        simulation.begin()
        simulation.run()
        commands = np.array([command for _, command in simulation.commands])
        assert simulation.robot.joint_limits.contains(commands)


def test_an_example_where_the_robot_does_not_settle_is_tried_again_at_the_end(make) -> None:
    simulation = make()
    simulation.begin()
    troubled = simulation.row
    visits = []

    def shaken(joints: np.ndarray) -> np.ndarray:
        shakes = simulation.collector._visit is not None and simulation.row == troubled
        visits.append(simulation.row if simulation.collector._visit else None)
        if not shakes or len(simulation.collector.journal.examples) == 4:
            return joints
        return joints + 0.02 * math.sin(40.0 * simulation.now)

    simulation.measure_joints = shaken
    simulation.run()
    journal = simulation.collector.journal
    assert journal.is_complete
    assert tuple(journal.examples)[-1] == troubled
    assert simulation.collector.queue.failures == 1
    assert not simulation.collector.queue.missing
    (warning,) = messages(simulation).warnings
    assert "did not come to rest within the settle_timeout of 1 s" in warning


def test_an_example_that_always_fails_is_missing_with_its_reason(make) -> None:
    simulation = make(max_retries=2, max_repeats=1)
    simulation.begin()
    hidden = simulation.row
    simulation.measure_pose = lambda pose: (
        None if simulation.collector._visit and simulation.row == hidden else pose
    )
    simulation.run()
    queue = simulation.collector.queue
    assert queue.failures == 3
    assert list(queue.missing) == [hidden]
    assert "0 of 4 measured poses came within the pose_timeout" in queue.missing[hidden]
    assert simulation.collector.repeated == 3
    assert len(simulation.collector.journal.examples) == 4


def test_a_command_outside_the_limits_is_not_given_though_the_path_seemed_allowed(
    make, monkeypatch
) -> None:
    def around(robot, safety, start, target, spacing):
        return Approach(np.array([start, robot.joint_limits.upper + 0.5, target]), None)

    monkeypatch.setattr("annik_core.collection.collector.approach", around)
    simulation = make()
    simulation.begin()
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.OUTSIDE_LIMITS
    commands = np.array([command for _, command in simulation.commands])
    assert (commands <= simulation.robot.joint_limits.upper).all()


def test_too_many_failures_in_a_row_stop_the_collection(make) -> None:
    simulation = make(max_failures_in_a_row=2, max_repeats=0)
    simulation.begin()
    simulation.measure_pose = lambda pose: None
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.FAILURES
    assert caught.value.reason.startswith("2 examples failed in a row, the last because 0 ")


def test_the_joint_positions_that_are_recorded_are_the_measured_ones(make) -> None:
    """Not those of the plan, from which a robot may stand a little away."""
    simulation = make()
    away = 0.5 * SETTINGS.settle_tolerance * np.array([1.0, -1.0, 0.5, 0.0, 0.2, -0.1])
    simulation.measure_joints = lambda joints: joints + away
    simulation.begin()
    simulation.run()
    examples = simulation.collector.journal.examples
    assert len(examples) == len(simulation.collector.journal.plan)
    for row, example in examples.items():
        planned = simulation.collector.journal.plan.joint_positions[row]
        # It stands as still as it is asked to.
        expected = pytest.approx(planned + away, abs=SETTINGS.still_tolerance)
        assert example.joint_positions == expected


def test_only_failures_in_a_row_stop_the_collection() -> None:
    queue = ExampleQueue(range(5), max_retries=0, max_failures_in_a_row=2)
    for row in range(4):
        assert queue.next_row() == row
        if row % 2:
            queue.record_failed(row, "fog")
        else:
            queue.record_done(row)
    assert queue.next_row() == 4
    with pytest.raises(CollectionStopped) as caught:
        queue.record_failed(4, "fog")
    assert caught.value.cause is StopCause.FAILURES


def test_dropped_poses_are_waited_for(make) -> None:
    simulation = make()
    simulation.begin()
    rng = np.random.default_rng(0)
    simulation.measure_pose = lambda pose: None if rng.random() < 0.7 else pose
    simulation.run()
    assert simulation.collector.journal.is_complete


@pytest.mark.parametrize(
    ("offset", "reason"),
    [(0.02, "is far from the others"), (0.0, None)],
)
def test_an_outlier_has_the_measurement_repeated(make, offset, reason) -> None:
    """And leaves no trace in what is recorded."""
    simulation = make()
    simulation.begin()
    count = [0]

    def sometimes_wild(pose: np.ndarray) -> np.ndarray:
        if simulation.collector.phase is Phase.MEASURING:
            count[0] += 1
            if count[0] == 2:
                return pose + np.array([offset, 0, 0, 0, 0, 0, 0])
        return pose

    simulation.measure_pose = sometimes_wild
    simulation.run()
    journal = simulation.collector.journal
    assert pose_distance(journal.plan.poses, journal.dataset().poses)[0].max() < 1e-3
    assert simulation.collector.repeated == (reason is not None)
    if reason is not None:
        assert reason in messages(simulation).warnings[0]


def test_a_tracker_in_another_frame_stops_the_collection_with_the_deviation(make) -> None:
    simulation = make(max_failures_in_a_row=3)
    simulation.begin()
    simulation.measure_pose = lambda pose: pose + np.array([0.1, 0, 0, 0, 0, 0, 0])
    with pytest.raises(CollectionStopped) as caught:
        simulation.run()
    assert caught.value.cause is StopCause.FAILURES
    assert "by 100 mm" in caught.value.reason
    assert not simulation.collector.journal.examples


def test_a_tracker_without_orientations_says_any(make) -> None:
    """As docs/learn_your_robot.md has it for positions alone."""
    simulation = make(max_orientation_deviation=math.inf)
    simulation.begin()
    simulation.measure_pose = lambda pose: np.array([*pose[:3], 0.0, 0.0, 0.0, 1.0])
    simulation.run()
    assert simulation.collector.journal.is_complete
    assert not messages(simulation).warnings


def test_a_robot_that_is_moved_while_it_is_measured_is_measured_again(make) -> None:
    simulation = make()
    simulation.begin()
    simulation.run(lambda: simulation.collector.phase is Phase.MEASURING)
    simulation.measure_joints = lambda joints: joints + 0.01
    simulation.step()
    simulation.step()
    assert simulation.collector.phase is Phase.SETTLING
    simulation.measure_joints = lambda joints: joints
    simulation.run()
    assert simulation.collector.journal.is_complete
    assert "moved while it was measured" in messages(simulation).warnings[0]


def test_an_example_outside_the_workspace_box_is_skipped_and_no_command_leaves_it(
    gantry, make
) -> None:
    plan = small_plan(gantry, 6)
    highest = int(plan.poses[:, 2].argmax())
    upper = float(np.sort(plan.poses[:, 2])[-2:].mean())
    simulation = make(plan, workspace_box_upper=(math.inf, math.inf, upper))
    simulation.begin()
    simulation.run()
    assert list(simulation.collector.queue.skipped) == [highest]
    assert "position.z is" in simulation.collector.queue.skipped[highest]
    assert len(simulation.collector.journal.examples) == 5
    commands = np.array([command for _, command in simulation.commands])
    assert gantry.forward_kinematics.poses(commands)[:, 2].max() <= upper


def test_an_arm_stays_inside_the_workspace_box_on_the_way(make) -> None:
    """Where its straight ways bulge; whatever is not skipped for it is measured."""
    scara = load_robot("scara")
    plan = small_plan(scara, 12, seed=2)
    lower, upper = (np.quantile(plan.poses[:, :3], share, axis=0) for share in (0.1, 0.9))
    centre = scara.forward_kinematics.poses(scara.joint_box.centre[None])[0, :3]
    lower, upper = np.minimum(lower, centre - 0.01), np.maximum(upper, centre + 0.01)
    simulation = make(
        plan,
        workspace_box_lower=tuple(lower),
        workspace_box_upper=tuple(upper),
        max_orientation_deviation=math.inf,
    )
    simulation.begin()
    simulation.run()
    skipped, measured = simulation.collector.queue.skipped, simulation.collector.journal.examples
    assert set(skipped) | set(measured) == set(range(12))
    assert skipped
    assert measured
    commands = np.array([command for _, command in simulation.commands])
    positions = scara.forward_kinematics.poses(commands)[:, :3]
    assert (positions >= lower).all()
    assert (positions <= upper).all()


def test_a_robot_outside_the_workspace_box_is_not_commanded(make) -> None:
    simulation = make(workspace_box_upper=(math.inf, math.inf, -1.0))
    with pytest.raises(CollectionStopped) as caught:
        simulation.begin()
    assert caught.value.cause is StopCause.OUTSIDE_LIMITS
    assert "workspace box" in caught.value.reason


def test_the_time_that_is_left_shrinks(gantry, make) -> None:
    simulation = make(plan_at(gantry, gantry.joint_box.sample(8, np.random.default_rng(3))))
    simulation.begin()
    assert simulation.collector.time_left(simulation.now) is None
    left = []
    for count in (2, 5, 7):
        simulation.run(lambda count=count: len(simulation.collector.journal.examples) == count)
        left.append(simulation.collector.time_left(simulation.now))
    assert left[0] > left[1] > left[2] > 0


def test_settling_takes_a_while_of_standing_still_at_the_target() -> None:
    settling = Settling(np.zeros(2), 0.1, 0.01, 1.0)
    near, far, other = np.array([0.05, 0.0]), np.array([0.0, 0.2]), np.array([0.035, 0.0])
    assert not settling.update(0.0, near)
    assert not settling.update(0.9, near)
    assert settling.update(1.0, near)
    assert not settling.update(1.1, far)
    assert not settling.update(1.2, near)
    assert not settling.update(2.1, other)  # near, but it moved
    assert not settling.update(2.3, other)
    assert settling.update(3.1, other)
    assert not settling.update(3.2, np.array([math.nan, 0.0]))


def test_a_queue_gives_every_row_and_those_that_failed_again() -> None:
    queue = ExampleQueue((4, 2, 7), 1, 10)
    assert queue.next_row() == 4
    queue.record_failed(4, "fog")
    assert queue.next_row() == 2
    queue.record_done(2)
    assert queue.next_row() == 7
    queue.record_skipped(7, "outside", for_good=True)
    assert queue.next_row() == 4
    assert queue.missing == {4: "fog"}
    queue.record_failed(4, "rain")
    assert queue.next_row() is None
    assert queue.missing == {4: "rain"}
    assert queue.skipped == {7: "outside"}


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.2, "0 s"), (59.0, "59 s"), (61.0, "1 min 1 s"), (3725.0, "1 h 2 min")],
)
def test_durations_are_said_as_people_do(seconds, words) -> None:
    assert duration_in_words(seconds) == words
