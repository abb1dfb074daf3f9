"""The node that turns target poses into joint commands."""

from __future__ import annotations

import sys
from pathlib import Path

from geometry_msgs.msg import Pose, PoseStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from annik_core.artifact import default_model_path, load_artifact, model_path
from annik_core.errors import AnnikError
from annik_core.ik_server import Answer, IkServer
from annik_core.unique_stamps import UniqueStamps
from annik_ros.declare_parameters import current_parameters, declare_parameters
from annik_ros.diagnostics import (
    DiagnosticReport,
    DiagnosticsPublisher,
    outcome_report,
    solve_time_values,
)
from annik_ros.parameters import IkNodeParameters
from annik_ros.qos import RESULT_DEPTH, reliable
from annik_ros.spin import run_node
from msg_tools.joint_state import joint_state_to_message
from msg_tools.pose import pose_stamped_to_message, unchecked_pose_from_message
from msg_tools.stamp import stamp_to_message
from msg_tools.topics import ACCEPTED_TARGET, JOINT_COMMAND, TARGET_POSE, TARGET_POSE_STAMPED

NODE_NAME = "ik_node"

#: Least time between two warnings of refused targets [s].
WARNING_PERIOD = 1.0


class IkNode(Node):
    """Answers every target with one joint command, or refuses it and says why."""

    def __init__(self) -> None:
        """Load the model and begin to serve.

        Raises:
            AnnikError: if a parameter or the model can't be used.
        """
        super().__init__(NODE_NAME)
        parameters = declare_parameters(self, IkNodeParameters)
        solver = parameters.solver(load_artifact(_model_path(parameters)))
        self._server = IkServer(solver)
        self._stamps = UniqueStamps()
        results = reliable(RESULT_DEPTH)
        self._target_publisher = self.create_publisher(PoseStamped, ACCEPTED_TARGET.name, results)
        self._command_publisher = self.create_publisher(JointState, JOINT_COMMAND.name, results)
        targets = reliable(parameters.queue_depth)
        self.create_subscription(Pose, TARGET_POSE.name, self._on_target, targets)
        self.create_subscription(
            PoseStamped, TARGET_POSE_STAMPED.name, self._on_stamped_target, targets
        )
        self.create_service(Trigger, "~/reload_model", self._on_reload)
        self.add_post_set_parameters_callback(self._on_parameters)
        self._diagnostics = DiagnosticsPublisher(self, self._report)
        self.get_logger().info(
            f"serving {self._server.solver.artifact.path} for robot "
            f"{self._server.solver.robot.name}: {TARGET_POSE.name} -> {JOINT_COMMAND.name}"
        )

    def _on_target(self, message: Pose) -> None:
        self._act_on(self._server.answer(unchecked_pose_from_message(message)))

    def _on_stamped_target(self, message: PoseStamped) -> None:
        pose = unchecked_pose_from_message(message.pose)
        self._act_on(self._server.answer(pose, message.header.frame_id))

    def _act_on(self, answer: Answer) -> None:
        if answer.command is None:
            self.get_logger().warning(
                f"target refused, {answer.result.status.value}: {answer.result.reason}",
                throttle_duration_sec=WARNING_PERIOD,
            )
            return
        robot = self._server.solver.robot
        stamp = stamp_to_message(self._stamps.next(self.get_clock().now().nanoseconds))
        command = joint_state_to_message(robot.joint_names, answer.command.joint_positions, stamp)
        target = pose_stamped_to_message(answer.command.target, stamp, robot.base_frame)
        self._target_publisher.publish(target)
        self._command_publisher.publish(command)

    def _on_reload(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self._server.load_model(_model_path(current_parameters(self, IkNodeParameters)))
        except AnnikError as error:
            response.success = False
            response.message = f"still serving {self._server.solver.artifact.path}: {error}"
            self.get_logger().error(f"reload refused: {response.message}")
        else:
            response.success = True
            response.message = f"now serving {self._server.solver.artifact.path}"
            self.get_logger().info(response.message)
        return response

    def _on_parameters(self, _: list[Parameter]) -> None:
        parameters = current_parameters(self, IkNodeParameters)
        self._server.solver = parameters.solver(self._server.solver.artifact)

    def _report(self) -> DiagnosticReport:
        summary = self._server.end_period()
        artifact = self._server.solver.artifact
        model = {
            "model": str(artifact.path),
            "model sha256": artifact.sha256[:12],
            "robot": artifact.robot.name,
            "mode": "refined" if self._server.solver.refines else "network",
        }
        return outcome_report(
            "target",
            summary.outcomes,
            artifact.robot.name,
            {**model, **solve_time_values(summary)},
        )


def _model_path(parameters: IkNodeParameters) -> Path:
    return model_path(parameters.model) if parameters.model else default_model_path()


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(NODE_NAME, IkNode, args)


if __name__ == "__main__":
    sys.exit(main())
