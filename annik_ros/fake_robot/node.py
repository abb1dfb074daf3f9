"""The node that simulates a robot and publishes its tracking error, never its imperfections."""

import sys
import time
from importlib import import_module

from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, Vector3Stamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from annik_core.errors import AnnikError, InvalidValue
from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray, checked_pose, tracking_error
from annik_core.robots.description import link_poses, robot_urdf
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.serving.stamps import StampPairing
from annik_core.serving.statistics import OutcomeCounts
from annik_core.simulation.fake_robot import FakeRobot, refusal_reason
from annik_core.simulation.imperfections import Imperfections
from annik_ros.declare_parameters import declare_parameters
from annik_ros.diagnostics import DiagnosticReport, DiagnosticsPublisher, outcome_report
from annik_ros.fake_robot.parameters import FakeRobotParameters
from annik_ros.qos import RESULT_DEPTH, reliable
from annik_ros.run_node import run_node
from annik_ros.throttle import Throttle
from msg_tools.conversions.joint_state import joint_state_from_array, joint_state_to_array
from msg_tools.conversions.pose import (
    pose_stamped_from_array,
    pose_to_array,
    transform_stamped_from_array,
    vector3_stamped_from_array,
)
from msg_tools.conversions.stamp import InvalidStamp, nearest_stamp, stamp_to_nanoseconds
from msg_tools.topics import (
    ACCEPTED_TARGET,
    ACHIEVED_POSE,
    JOINT_COMMAND,
    JOINT_STATES,
    MEASURED_POSE,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    ROBOT_DESCRIPTION,
)

NODE_NAME = "fake_robot"

#: Relative, so that robots in namespaces do not mix; without a namespace it is /tf.
TF_TOPIC = "tf"


class FakeRobotNode(Node):
    """Moves to every valid command at once, and publishes the resulting pose."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        parameters = declare_parameters(self, FakeRobotParameters)
        robot = _load(parameters)
        imperfections = parameters.robot_imperfections(robot)
        self._fake_robot = FakeRobot(robot, imperfections)
        self._noise = (imperfections or Imperfections.none(robot.dof)).measurement_generator()
        self._counts = OutcomeCounts(time.monotonic())
        self._refused_targets = 0
        self._measurements_published = self._measurements_dropped = 0
        self._warning = Throttle()
        self._pairing: StampPairing[FloatArray, FloatArray] = StampPairing()
        results = reliable(RESULT_DEPTH)
        self._state_publisher = self.create_publisher(JointState, JOINT_STATES.name, results)
        self._pose_publisher = self.create_publisher(PoseStamped, ACHIEVED_POSE.name, results)
        self._tf_publisher: Publisher | None = None
        if parameters.publish_robot_description:
            given = "" if parameters.model else parameters.robot_description
            self._show(given or robot_urdf(robot))
        # What is measured comes with joint states too.
        if parameters.joint_state_rate > parameters.measurement_rate:
            self.create_timer(1.0 / parameters.joint_state_rate, self._publish_joint_states)
        if parameters.measurement_rate > 0.0:
            self._measurement_publisher = self.create_publisher(
                PoseStamped, MEASURED_POSE.name, results
            )
            self.create_timer(1.0 / parameters.measurement_rate, self._measure)
        self._error_publishers = [
            self.create_publisher(Vector3Stamped, topic.name, results)
            for topic in (POSITION_ERROR, ORIENTATION_ERROR)
        ]
        commands = self.create_subscription(
            JointState, JOINT_COMMAND.name, self._on_command, results
        )
        self.create_subscription(PoseStamped, ACCEPTED_TARGET.name, self._on_target, results)
        self._diagnostics = DiagnosticsPublisher(self, self._report)
        self.get_logger().info(
            f"{'fake' if imperfections is None else 'imperfect fake'} robot {robot.name}: "
            f"{commands.topic_name} -> {self._state_publisher.topic_name}"
        )

    def _on_command(self, message: JointState) -> None:
        robot = self._fake_robot.robot
        try:
            # Before the robot moves: without a stamp, the result can't be told from others.
            nanoseconds = stamp_to_nanoseconds(message.header.stamp)
            joint_positions = joint_state_to_array(message, robot.joint_names)
            achieved = self._fake_robot.move_to(joint_positions)
        except AnnikError as error:
            self._counts.record_refused(_refusal_reason(error), str(error))
            self._warn(f"command refused: {error}")
            return
        self._counts.record_accepted()
        stamp = message.header.stamp
        self._state_publisher.publish(
            joint_state_from_array(joint_positions, robot.joint_names, stamp)
        )
        self._pose_publisher.publish(pose_stamped_from_array(achieved, stamp, robot.base_frame))
        self._publish_error(nanoseconds, self._pairing.add_second(nanoseconds, achieved))

    def _show(self, urdf: str) -> None:
        """Publish a URDF, latched, and from now on the poses of the links."""
        latched = reliable(1)
        latched.durability = DurabilityPolicy.TRANSIENT_LOCAL
        publisher = self.create_publisher(String, ROBOT_DESCRIPTION.name, latched)
        publisher.publish(String(data=urdf))
        try:
            self._tf_message = import_module("tf2_msgs.msg").TFMessage
        except ImportError:
            self.get_logger().info("tf2_msgs is not installed: no tf is published")
            return
        robot = self._fake_robot.robot
        self._described = robot_from_definition(robot.nominal_definition, robot.name)
        self._tf_publisher = self.create_publisher(self._tf_message, TF_TOPIC, reliable(100))

    def _publish_joint_states(self) -> Time:
        """Publish joint positions, and the poses of the links, at this time; returns its stamp."""
        robot, joint_positions = self._fake_robot.robot, self._fake_robot.joint_positions
        stamp = nearest_stamp(self.get_clock().now().nanoseconds)
        # The encoders do not see the imperfections.
        self._state_publisher.publish(
            joint_state_from_array(joint_positions, robot.joint_names, stamp)
        )
        if self._tf_publisher is not None:
            transforms = [
                transform_stamped_from_array(pose, stamp, robot.base_frame, link)
                for link, pose in link_poses(self._described, joint_positions).items()
            ]
            self._tf_publisher.publish(self._tf_message(transforms=transforms))
        return stamp

    def _measure(self) -> None:
        robot = self._fake_robot.robot
        stamp = self._publish_joint_states()
        pose = self._fake_robot.measure(self._noise)
        if pose is None:
            self._measurements_dropped += 1
            return
        self._measurement_publisher.publish(pose_stamped_from_array(pose, stamp, robot.base_frame))
        self._measurements_published += 1

    def _on_target(self, message: PoseStamped) -> None:
        try:
            nanoseconds = stamp_to_nanoseconds(message.header.stamp)
            target = checked_pose(pose_to_array(message.pose))
        except AnnikError as error:
            self._refused_targets += 1
            self._warn(f"accepted target ignored: {error}")
            return
        self._publish_error(nanoseconds, self._pairing.add_first(nanoseconds, target))

    def _publish_error(self, nanoseconds: int, pair: tuple[FloatArray, FloatArray] | None) -> None:
        if pair is None:
            return
        error = tracking_error(*pair)
        stamp = nearest_stamp(nanoseconds)
        frame = self._fake_robot.robot.base_frame
        parts = error.position, error.orientation
        for publisher, part in zip(self._error_publishers, parts, strict=True):
            publisher.publish(vector3_stamped_from_array(part, stamp, frame))

    def _warn(self, text: str) -> None:
        if self._warning.is_due():
            self.get_logger().warning(text)

    def _report(self) -> DiagnosticReport:
        robot = self._fake_robot.robot
        waiting_targets, waiting_commands = self._pairing.waiting
        values = {
            "robot": robot.name,
            "robot definition sha256": robot.definition_hash[:12],
            # Not "targets refused", which identifies the diagnostics of ik_node in a report.
            "accepted targets ignored": str(self._refused_targets),
            "targets without command": str(waiting_targets),
            "commands without target": str(waiting_commands),
            "partners given up": str(self._pairing.given_up),
            "measurements published": str(self._measurements_published),
            "measurements dropped": str(self._measurements_dropped),
        }
        outcomes = self._counts.end_period(time.monotonic())
        return outcome_report("command", outcomes, robot.name, values)


def _refusal_reason(error: AnnikError) -> str:
    return "malformed stamp" if isinstance(error, InvalidStamp) else refusal_reason(error)


def _load(parameters: FakeRobotParameters) -> Robot:
    frames = [name for name in ("base_frame", "end_effector_frame") if getattr(parameters, name)]
    if parameters.model and frames:
        raise InvalidValue(
            frames[0],
            getattr(parameters, frames[0]),
            "empty together with model, which has its own",
        )
    if parameters.model:
        return load_model(parameters.model).robot
    return load_robot(
        parameters.robot_description or parameters.robot,
        base_frame=parameters.base_frame or None,
        end_effector_frame=parameters.end_effector_frame or None,
    )


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(NODE_NAME, FakeRobotNode, FakeRobotParameters, args)


if __name__ == "__main__":
    sys.exit(main())
