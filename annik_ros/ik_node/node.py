"""The node that turns target poses into joint commands."""

import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from dataclasses import replace
from pathlib import Path
from traceback import format_exception
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from annik_core.errors import AnnikError, ConversionError
from annik_core.installation import default_model_path, model_path
from annik_core.kernel import NO_KERNEL, compiled_kernel
from annik_core.robots.robot import Robot
from annik_core.robots.task import Task
from annik_core.safety import IkStatus, Refusal
from annik_core.solver.result import IkResult
from annik_ros.declare_parameters import current_parameters, declare_parameters
from annik_ros.diagnostics import (
    DiagnosticReport,
    DiagnosticsPublisher,
    Level,
    OtherCommanders,
    expected_error_values,
    outcome_report,
    time_values,
)
from annik_ros.ik_node.compute_ik import compute_ik, service_type
from annik_ros.ik_node.frames import NoTransform, TargetFrames
from annik_ros.ik_node.parameters import (
    COMPUTE_IK,
    RELOAD_MODEL,
    IkNodeParameters,
    OnRefusal,
)
from annik_ros.ik_node.publishers import CommandPublishers
from annik_ros.managed_node import ManagedNode, logged
from annik_ros.measured_joint_positions import MeasuredJointPositions
from annik_ros.qos import RESULT_DEPTH, best_effort, reliable
from annik_ros.run_node import make_executor, run_node
from annik_ros.throttle import Throttle
from msg_tools.conversions.cdr import (
    StampedPoses,
    pose_array_from_bytes,
    pose_numbers_from_bytes,
    pose_stamped_from_bytes,
)
from msg_tools.topics import (
    SOLUTIONS_TARGET,
    TARGET_POSE,
    TARGET_POSE_STAMPED,
    TARGET_POSES,
    Topic,
)

if TYPE_CHECKING:
    from annik_core.model.artifact import Model

NODE_NAME = "ik_node"

Content = TypeVar("Content")
_Read = Callable[[bytes], StampedPoses]

#: Time from one look whether a model is loaded to the next [s].
RELOAD_POLL = 0.02
#: Longest wait at the end for a model that is being loaded [s]; the disk may hang.
RELOAD_AT_END = 1.0


class Serving:
    """The model, the subscriptions and the publishers of a configured node."""

    def __init__(self, node: "IkNode", options: IkNodeParameters) -> None:
        self._node = node
        # First, so that other nodes discover them while the model is loaded.
        self.publishers = CommandPublishers(node, options)
        self.others = OtherCommanders(node, self.publishers.topic_name)
        self._depth = options.queue_depth
        self._targets: dict[Topic, tuple[type, Callable[[bytes], None]]] = {
            TARGET_POSE: (Pose, node.on_target),
            TARGET_POSE_STAMPED: (PoseStamped, node.on_stamped_target),
            TARGET_POSES: (PoseArray, node.on_path),
        }
        #: Topics with a publisher that does not repeat what was lost: newly met, and received so.
        self._unreliable: set[Topic] = set()
        self._best_effort: set[Topic] = set()
        self._subscriptions: dict[Topic, Subscription] = {}
        for topic in self._targets:
            self._subscribe(topic)
        # None is replaced by a later one, since each is answered.
        self._subscriptions[SOLUTIONS_TARGET] = node.create_subscription(
            PoseStamped,
            SOLUTIONS_TARGET.name,
            node.on_solutions_target,
            reliable(RESULT_DEPTH),
            raw=True,
        )
        try:
            # Not above: they load slowly.
            from annik_core.model.artifact import load_model
            from annik_core.serving.ik_server import IkServer

            solver = options.solver(load_model(_model_path(options)))
        except Exception:
            self._destroy_endpoints()
            raise
        robot = solver.robot
        self.publishers.set_robot(robot)
        self.measured = MeasuredJointPositions(
            node, robot.joint_names, options.measurement_timeout
        )
        self.server = IkServer(solver, options.command_safety, self.measured)

    def _subscribe(self, topic: Topic, make_qos: Callable[[int], QoSProfile] = reliable) -> None:
        qos, events = make_qos(self._depth), None
        if make_qos is reliable:
            events = SubscriptionEventCallbacks(
                incompatible_qos=lambda _: self._unreliable.add(topic)
            )
        message_type, callback = self._targets[topic]
        self._subscriptions[topic] = self._node.create_subscription(
            message_type, topic.name, callback, qos, raw=True, event_callbacks=events
        )

    def meet_publishers(self) -> None:
        """Receive without repetition while there is a publisher that offers nothing else."""
        for topic in [topic for topic in self._best_effort if not self._has_unreliable(topic)]:
            self._best_effort.remove(topic)
            name = self._subscriptions[topic].topic_name
            self._node.get_logger().info(f"{name} is received reliably again")
            self._node.destroy_subscription(self._subscriptions[topic])
            self._subscribe(topic)
        while self._unreliable:
            topic = self._unreliable.pop()
            self._best_effort.add(topic)
            earlier = self._subscriptions[topic]
            self._node.get_logger().warning(
                f"{earlier.topic_name} has a publisher with best-effort delivery: while it is "
                "there, lost targets are not repeated; publish them reliably if each one counts"
            )
            self._node.destroy_subscription(earlier)
            self._subscribe(topic, best_effort)

    def _has_unreliable(self, topic: Topic) -> bool:
        """Whether a publisher of a topic does not repeat what was lost."""
        name = self._subscriptions[topic].topic_name
        return any(
            publisher.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT
            for publisher in self._node.get_publishers_info_by_topic(name)
        )

    @property
    def topics(self) -> str:
        """The resolved names of the targets' and the commands' topics."""
        return f"{self._subscriptions[TARGET_POSE].topic_name} -> {self.publishers.topic_name}"

    def apply(self, options: IkNodeParameters) -> None:
        """Apply parameters that may change between two targets."""
        self.server.solver = options.solver(self.server.solver.artifact)
        self.server.safety = options.command_safety
        self.measured.joints.timeout = options.measurement_timeout
        self.publishers.options = options

    def destroy(self) -> None:
        """Destroy subscriptions and publishers."""
        self.measured.destroy()
        self._destroy_endpoints()

    def _destroy_endpoints(self) -> None:
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self.publishers.destroy()


class Reload(NamedTuple):
    """A reload that is under way, and its response with the address that it goes to."""

    job: "Future[Model]"
    serving: Serving
    response: Trigger.Response
    header: object = None


class IkNode(ManagedNode):
    """Publishes one joint command for every target, or refuses it with a reason."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.options = declare_parameters(self, IkNodeParameters)
        self._frames = TargetFrames(self, self.options.transform_timeout)
        self._serving: Serving | None = None
        self._active = False
        self._fault: AnnikError | ImportError | None = None
        self._callback_errors = 0
        self._warning, self._error = Throttle(), Throttle()
        self._reload: Reload | None = None
        self._reload_timer = self.create_timer(
            RELOAD_POLL,
            self._finish_reload,
            clock=Clock(clock_type=ClockType.STEADY_TIME),
            autostart=False,
        )
        # As deep as results, or most of many calls at once would never have a response.
        service = self.create_service(
            Trigger, RELOAD_MODEL, self._on_reload, qos_profile=reliable(RESULT_DEPTH)
        )
        if (compute_ik_type := service_type()) is not None:
            self.create_service(compute_ik_type, COMPUTE_IK, self._on_compute_ik)
        # Executors send the response when the callback returns; those of Jazzy know no other way.
        self._send_response, service.send_response = service.send_response, self._respond
        self.add_post_set_parameters_callback(self._on_parameters)
        self._diagnostics = DiagnosticsPublisher(self, self._report, self._unheard)
        self._starts_itself = self.options.autostart
        if self._starts_itself:
            self.trigger_configure()
            if self._fault is not None:
                raise self._fault
            self.trigger_activate()
            if not self._active:
                raise AnnikError("ik_node can't be activated: see the error above")
            self._starts_itself = False
        else:
            self.get_logger().info("unconfigured: waiting for lifecycle transitions")

    @logged
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the model and subscribe."""
        self._fault = None
        try:
            self._serving = Serving(self, self.options)
        except (AnnikError, ImportError) as error:
            self._fault = error
            if not self._starts_itself:
                self.get_logger().error(f"not configured: {error}")
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    @logged
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to publish commands; the next one is checked as the first."""
        if self._serving is None:
            return TransitionCallbackReturn.FAILURE
        self._serving.server.forget_last_command()
        self._serving.publishers.forget()
        self._active = True
        model = self._serving.server.solver.artifact
        self._announce(
            f"serving {model.path} for robot {model.robot.name}: {self._serving.topics}", model
        )
        task = self._serving.server.solver.task
        if task is not Task.POSE:
            self.get_logger().info(
                f"task {task.value}: where this arm can't reach the orientation of a target, it "
                "comes as near as possible"
            )
        return super().on_activate(state)

    @logged
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish no more commands."""
        self._active = False
        self.get_logger().info("inactive: targets are refused")
        return super().on_deactivate(state)

    @logged
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release the model: to be unconfigured again, for good, or after an error."""
        self._active = False
        if self._serving is not None:
            serving, self._serving = self._serving, None
            serving.destroy()
        return super().on_cleanup(state)

    on_shutdown = on_error = on_cleanup

    def destroy_node(self) -> None:
        """Destroy the node, after a reload that is about to be done."""
        if self._reload is not None:
            wait([self._reload.job], RELOAD_AT_END)
        super().destroy_node()

    def on_target(self, data: bytes) -> None:
        """Solve a target without a header."""
        arrival = time.perf_counter()
        received = self._received(data, pose_numbers_from_bytes)
        if received is None:
            return
        serving, pose = received
        self._act_on(serving, serving.server.solve(pose), arrival)

    def on_stamped_target(self, data: bytes) -> None:
        """Solve a target with a frame and a stamp."""
        arrival = time.perf_counter()
        received = self._received(data, self._in_base_frame(pose_stamped_from_bytes))
        if received is None:
            return
        serving, target = received
        result = serving.server.solve(target.poses[0], target.frame_id, self._age(target))
        self._act_on(serving, result, arrival)

    def on_path(self, data: bytes) -> None:
        """Solve a path as a whole."""
        received = self._received(data, self._in_base_frame(pose_array_from_bytes))
        if received is None:
            return
        serving, path = received
        path_result = serving.server.solve_path(
            path.poses,
            self.options.trajectory_interval,
            self.options.max_path_poses,
            path.frame_id,
            self._age(path),
        )
        if path_result.refusal is not None:
            self._refused(serving, path_result.refusal)
        elif path_result.joint_positions is not None:
            serving.publishers.publish_path(path_result.joint_positions)

    def on_solutions_target(self, data: bytes) -> None:
        """Publish all solutions of a pose, none if it is refused."""
        serving = self._serving
        if serving is None or not self._active:
            return
        try:
            request = pose_stamped_from_bytes(data)
        except ConversionError as error:
            self._warn_of_solutions(f"malformed message: {error}")
            return
        try:
            target = self._in_base_frame(lambda _: request)(data)
            turns = self.options.solution_turns
            found = serving.server.solutions(target.poses[0], target.frame_id, turns=turns)
        except NoTransform as error:
            found = Refusal(IkStatus.WRONG_FRAME, str(error))
        if isinstance(found, Refusal):
            self._warn_of_solutions(f"{found.status.value}: {found.reason}")
            found = []
        serving.publishers.publish_solutions(found, request.nanoseconds)

    def _warn_of_solutions(self, problem: str) -> None:
        if self._warning.is_due():
            self.get_logger().warning(f"no solutions are sought, {problem}")

    def on_error_of_callback(self, error: Exception) -> None:
        """Count and log an unexpected error, and continue."""
        self._callback_errors += 1
        if self._error.is_due():
            text = "".join(format_exception(error)).strip()
            self.get_logger().error(f"error in a callback, continuing: {text}")

    def _received(
        self, data: bytes, read: Callable[[bytes], Content]
    ) -> tuple[Serving, Content] | None:
        """The serving state and the content of a message; None if it is refused."""
        serving = self._serving
        if serving is None:
            return None
        if not self._active:
            reason = "the node is inactive: activate it (ros2 lifecycle set NODE activate)"
            self._warn(serving.server.refuse(IkStatus.NOT_ACTIVE, reason))
            return None
        try:
            return serving, read(data)
        except ConversionError as error:
            refusal = serving.server.refuse(IkStatus.MALFORMED_MESSAGE, str(error))
        except NoTransform as error:
            refusal = serving.server.refuse(IkStatus.WRONG_FRAME, str(error))
        self._refused(serving, refusal)
        return None

    def _in_base_frame(self, read: _Read) -> _Read:
        """Read a message as ``read`` does, and transform its poses; may raise NoTransform."""
        base_frame = self._serving.server.solver.robot.base_frame if self._serving else ""
        return lambda data: self._frames.in_base_frame(read(data), base_frame)

    def _age(self, target: StampedPoses) -> float:
        return 1e-9 * (self.get_clock().now().nanoseconds - target.nanoseconds)

    def _act_on(self, serving: Serving, result: IkResult, arrival: float) -> None:
        if not result.accepted:
            self._refused(serving, result)
            return
        serving.publishers.publish(result)
        serving.server.record_latency(time.perf_counter() - arrival)

    def _refused(self, serving: Serving, refusal: IkResult) -> None:
        if self.options.on_refusal is OnRefusal.HOLD:
            serving.publishers.repeat()
        self._warn(refusal)

    def _warn(self, refusal: IkResult) -> None:
        if self._warning.is_due():
            self.get_logger().warning(f"target refused, {refusal.status.value}: {refusal.reason}")

    def _on_reload(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Begin a reload, whose response comes later; other calls meanwhile are refused."""
        from annik_core.model.artifact import load_model

        if self._serving is None:
            response.message = f"no model is served when the node is {self.state_label}"
        elif self._reload is not None:
            response.message = "busy: a reload is under way; call again when it has its response"
        else:
            # Meanwhile targets are solved with the present model.
            options, robot = self.options, self._serving.server.solver.robot
            # All of it there: what is raised here would end the node.
            job = _in_background(lambda: load_model(_model_path(options), robot))
            self._reload = Reload(job, self._serving, response)
            self._reload_timer.reset()
        return response

    def _on_compute_ik(self, request: Any, response: Any) -> Any:
        serving = self._serving if self._active else None
        server = None if serving is None else serving.server
        in_base_frame = self._in_base_frame(pose_stamped_from_bytes)
        return compute_ik(server, in_base_frame, request, response)

    def _respond(self, response: Trigger.Response, header: object) -> None:
        """Send a response now, or keep the address of the one that comes later."""
        if self._reload is not None and response is self._reload.response:
            self._reload = self._reload._replace(header=header)
        else:
            self._send_response(response, header)

    def _finish_reload(self) -> None:
        """Use a model that is loaded, between two targets, and send the response."""
        if self._reload is None or not self._reload.job.done():
            return
        self._reload_timer.cancel()
        (job, serving, response, header), self._reload = self._reload, None
        try:
            model = job.result()
        except Exception as error:  # whatever it is, the call must have its response
            response.message = f"still serving {serving.server.solver.artifact.path}: {error}"
            self.get_logger().error(f"reload refused: {response.message}")
        else:
            # Parameters may have changed the solver since.
            serving.server.solver = replace(serving.server.solver, artifact=model)
            response.success = self._serving is serving
            response.message = f"now serving {model.path}, {_kinematics(model.robot)}"
            if not response.success:
                response.message = "the node was cleaned up during the reload: configure it"
        self._send_response(response, header)
        if response.success:
            self._announce(response.message, serving.server.solver.artifact)

    def _announce(self, text: str, model: "Model") -> None:
        if model.robot.kind == "arm" and compiled_kernel() is None:
            self.get_logger().warning(": ".join(NO_KERNEL))
        if model.quality.concerns:
            self.get_logger().warning(f"model {model.path}: {model.quality}")
        self.announce(text)

    def _on_parameters(self, _: list[Parameter]) -> None:
        self.options = current_parameters(self, IkNodeParameters)
        if self._serving is not None:
            self._serving.apply(self.options)

    def _unheard(self) -> None:
        """What is due once a second although nobody listens to a report."""
        if self._serving is not None:
            self._serving.meet_publishers()
            self._serving.others.trouble()
            self._serving.server.begin_period()

    def _report(self) -> DiagnosticReport:
        state = {"state": self.state_label, "callback errors": str(self._callback_errors)}
        if self._serving is None:
            return DiagnosticReport(Level.OK, self.state_label, "", state)
        server = self._serving.server
        self._serving.meet_publishers()
        summary = server.end_period()
        artifact = server.solver.artifact
        model = {
            "model": str(artifact.path),
            "model sha256": artifact.sha256[:12],
            "model quality": str(artifact.quality),
            "robot": artifact.robot.name,
            "mode": server.solver.chosen_mode.value,
            "task": server.solver.task.value,
            "forward kinematics": _kinematics(artifact.robot),
        }
        return outcome_report(
            "target",
            summary.outcomes,
            artifact.robot.name,
            {
                **state,
                **model,
                **self._serving.measured.diagnostic_values(),
                **time_values(summary),
                **expected_error_values(summary),
                "solutions requested": str(summary.solution_requests),
                "solutions found": str(summary.solutions_found),
            },
            self.options.command_safety.expected_rate if self._active else 0.0,
            self._serving.others.trouble(),
        )


def _in_background(work: Callable[[], Content]) -> "Future[Content]":
    """The future of work on a thread that never keeps the process from ending."""
    job: Future[Content] = Future()

    def run() -> None:
        try:
            job.set_result(work())
        except BaseException as error:
            job.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return job


def _kinematics(robot: Robot) -> str:
    """The origin of the forward kinematics."""
    corrections = robot.definition.get("corrections")
    if corrections is None:
        return "as described"
    examples = corrections.get("provenance", {}).get("examples", "?")
    return f"learned from {examples} measured poses"


def _model_path(options: IkNodeParameters) -> Path:
    return model_path(options.model) if options.model else default_model_path()


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(
        NODE_NAME,
        IkNode,
        IkNodeParameters,
        args,
        executor=lambda node: make_executor(node.options.executor),
        on_error=IkNode.on_error_of_callback,
    )


if __name__ == "__main__":
    sys.exit(main())
