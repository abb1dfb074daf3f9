"""The node that moves a robot through a plan of examples and records the measured poses."""

import sys
import time
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import JointState

from annik_core.collection.collector import (
    CollectionIncomplete,
    Collector,
    Phase,
    duration_in_words,
)
from annik_core.collection.journal import CollectionJournal, open_journal
from annik_core.collection.row_ranges import row_ranges
from annik_core.dataset import load_dataset, save_dataset
from annik_core.errors import AnnikError, NonFiniteValue, NotUnitQuaternion
from annik_core.pose import FloatArray, checked_pose
from annik_core.robots.robot import Robot
from annik_core.serving.measured_joints import MeasuredPositions
from annik_core.serving.statistics import OutcomeCounts
from annik_ros.declare_parameters import declare_parameters
from annik_ros.diagnostics import (
    ROWS_MEASURED,
    DiagnosticReport,
    DiagnosticsPublisher,
    OtherCommanders,
    outcome_report,
)
from annik_ros.example_collector.by_hand import HandGuidedRecording
from annik_ros.example_collector.parameters import ExampleCollectorParameters
from annik_ros.measured_joint_positions import MeasuredJointPositions
from annik_ros.qos import reliable
from annik_ros.run_node import NotInTime, run_node
from annik_ros.throttle import Throttle
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import pose_to_array
from msg_tools.conversions.stamp import nearest_stamp, stamp_to_nanoseconds
from msg_tools.topics import JOINT_COMMAND, MEASURED_POSE

NODE_NAME: Final = "example_collector"

#: Period of checks whether robot and tracker are there [s].
POLL_PERIOD: Final = 0.05
#: Time from then to the first command [s]: a subscriber is known here before this publisher is
#: known there, and a lost command would look like a robot that does not follow.
MEETING_TIME: Final = 1.0
#: Depth of the commands: old ones are useless.
COMMAND_DEPTH: Final = 10


class RefusedPose(AnnikError):
    """A measured pose is in the wrong frame, or is the previous measurement again."""

    def __init__(self, reason: str, problem: str) -> None:
        self.reason = reason
        super().__init__(f"the measured pose {problem}")


def _refusal_reason(error: AnnikError) -> str:
    if isinstance(error, RefusedPose):
        return error.reason
    if isinstance(error, NonFiniteValue):
        return "not finite"
    return "not a unit quaternion" if isinstance(error, NotUnitQuaternion) else "malformed stamp"


class ExampleCollector(Node):
    """Moves a robot through a plan and measures it; or records one that is guided by hand."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.finished = Future()
        self._started = time.monotonic()
        self._options = declare_parameters(self, ExampleCollectorParameters)
        self._by_hand: HandGuidedRecording | None = None
        if self._options.by_hand:
            self._by_hand = HandGuidedRecording(self, self._options)
            return
        plan_path, self._dataset_path = self._options.paths
        plan = load_dataset(plan_path)
        self._settings = self._options.settings
        self._robot: Robot = plan.robot
        self._counts = OutcomeCounts(time.monotonic())
        self._warning = Throttle()
        self._last_stamp = 0
        self._has_pose = False
        self._deadline = time.monotonic() + self._options.wait_timeout
        self._ready_since: float | None = None
        self._measured = MeasuredJointPositions(
            self, plan.robot.joint_names, self._settings.measurement_timeout
        )
        measured_pose = self.create_subscription(
            PoseStamped, MEASURED_POSE.name, self._on_pose, qos_profile_sensor_data
        )
        self._publisher = self.create_publisher(
            JointState, JOINT_COMMAND.name, reliable(COMMAND_DEPTH)
        )
        self._others = OtherCommanders(self, self._publisher.topic_name)
        # Last, so that an earlier error leaves no file.
        self._journal: CollectionJournal = open_journal(
            self._dataset_path, plan, self._settings.samples
        )
        self._collector = Collector(self._journal, self._settings, self.get_logger())
        self._diagnostics = DiagnosticsPublisher(self, self._report)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(POLL_PERIOD, self._wait_for_robot, clock=self._steady)
        self.get_logger().info(
            f"{len(self._journal.examples)} of {len(plan)} examples of robot {plan.robot.name} "
            f"are measured: {self._measured.topic_name}, {measured_pose.topic_name} -> "
            f"{self._publisher.topic_name}"
        )

    def write_dataset(self) -> str:
        """Write the measured examples and close the journal; returns one line on what was written.

        What was recorded by hand is in its file already.

        Raises:
            AnnikError: if the dataset can't be written. The journal has all measurements.
        """
        if self._by_hand is not None:
            return self._by_hand.progress()
        try:
            # A signal may have interrupted the record of an example.
            self._journal.reload()
            if not self._journal.examples:
                return "nothing was measured, and no dataset written"
            save_dataset(self._journal.dataset(), self._dataset_path)
        finally:
            self._journal.close()
        return (
            f"wrote {len(self._journal.examples)} of {len(self._journal.plan)} examples to "
            f"{self._dataset_path} after {duration_in_words(time.monotonic() - self._started)}"
        )

    def _wait_for_robot(self) -> None:
        if self._journal.is_complete:
            self.finished.set_result(None)
            return
        now = time.monotonic()
        measured = self._measured.newest()
        missing = self._missing(measured is None)
        if missing:
            self._ready_since = None
            if now > self._deadline:
                raise NotInTime(
                    f"no {' and no '.join(missing)}",
                    self._options.wait_timeout,
                    "is it running, in the same namespace and ROS_DOMAIN_ID, and are its topics "
                    "remapped?",
                )
            return
        if self._ready_since is None:
            self._ready_since = now
        if measured is None or now - self._ready_since < MEETING_TIME:
            return
        self._others.trouble()
        self._begin(measured)

    def _missing(self, no_joint_states: bool) -> tuple[str, ...]:
        """What is missing, in words."""
        joints = ", ".join(self._robot.joint_names)
        fault = self._measured.missing() if no_joint_states else None
        reason = f" ({fault})" if fault else ""
        conditions = (
            (no_joint_states, f"{self._measured.topic_name} that has {joints}{reason}"),
            (not self._has_pose, f"{self.resolve_topic_name(MEASURED_POSE.name)} of use"),
            (
                self._publisher.get_subscription_count() == 0,
                f"subscriber of {self._publisher.topic_name}",
            ),
        )
        return tuple(what for is_missing, what in conditions if is_missing)

    def _begin(self, measured: MeasuredPositions) -> None:
        self.destroy_timer(self._timer)
        self._collector.begin(time.monotonic(), measured)
        self._timer = self.create_timer(
            1.0 / self._settings.command_rate, self._tick, clock=self._steady
        )

    def _tick(self) -> None:
        measured = self._measured.newest()
        fault = self._measured.missing() if measured is None else None
        self._publish(self._collector.tick(time.monotonic(), measured, fault))
        if self._collector.phase is Phase.DONE:
            self.destroy_timer(self._timer)
            queue = self._collector.queue
            if queue.skipped:
                rows = ", ".join(map(str, sorted(queue.skipped)))
                self.get_logger().warning(
                    f"{len(queue.skipped)} examples were skipped, since the robot may not go "
                    f"there: rows {rows}"
                )
            if queue.missing:
                raise CollectionIncomplete(queue.missing)
            self.finished.set_result(None)

    def _publish(self, command: FloatArray) -> None:
        stamp = nearest_stamp(self.get_clock().now().nanoseconds)
        self._publisher.publish(joint_state_from_array(command, self._robot.joint_names, stamp))

    def _on_pose(self, message: PoseStamped) -> None:
        now = time.monotonic()
        try:
            pose = self._checked_pose(message)
        except AnnikError as error:
            self._counts.record_refused(_refusal_reason(error), str(error))
            if self._warning.is_due():
                self.get_logger().warning(f"measured pose refused: {error}")
            return
        self._counts.record_accepted()
        self._has_pose = True
        self._collector.on_pose(now, pose)

    def _checked_pose(self, message: PoseStamped) -> FloatArray:
        frame = message.header.frame_id
        if frame not in ("", self._robot.base_frame):
            raise RefusedPose(
                "wrong frame",
                f"is in the frame {frame!r}; it must be in the base frame "
                f"{self._robot.base_frame!r}, or name none",
            )
        nanoseconds = stamp_to_nanoseconds(message.header.stamp)
        # A publisher without a clock leaves the stamp at zero.
        if nanoseconds != 0 and nanoseconds == self._last_stamp:
            raise RefusedPose(
                "repeated stamp",
                f"has the stamp of the previous one, {nanoseconds} ns: one measurement is not "
                "averaged with itself",
            )
        self._last_stamp = nanoseconds
        return checked_pose(pose_to_array(message.pose))

    def _report(self) -> DiagnosticReport:
        now = time.monotonic()
        collector = self._collector
        left = collector.time_left(now)
        values = {
            "robot": self._robot.name,
            "robot definition sha256": self._robot.definition_hash[:12],
            "phase": collector.phase.value,
            "examples planned": str(len(self._journal.plan)),
            "examples measured": str(len(self._journal.examples)),
            ROWS_MEASURED: row_ranges(self._journal.examples),
            "examples failed": str(collector.queue.failures),
            "examples skipped": str(len(collector.queue.skipped)),
            "measurements repeated": str(collector.repeated),
            "time left [s]": "" if left is None else f"{left:.0f}",
            **self._measured.diagnostic_values(),
        }
        outcomes = self._counts.end_period(now)
        trouble = self._others.trouble()
        return outcome_report("pose", outcomes, self._robot.name, values, trouble=trouble)


def main(args: list[str] | None = None) -> int:
    """Collect until the plan is done or a signal; what was measured is written."""
    return run_node(
        NODE_NAME,
        ExampleCollector,
        ExampleCollectorParameters,
        args,
        finished=lambda node: node.finished,
        finish=ExampleCollector.write_dataset,
    )


if __name__ == "__main__":
    sys.exit(main())
