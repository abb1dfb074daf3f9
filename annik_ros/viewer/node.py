"""The node that shows the robot in the browser, and publishes targets dragged there."""

import math
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose, PoseStamped, Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from annik_core.collection.row_ranges import rows_in
from annik_core.dataset import Dataset, load_dataset
from annik_core.errors import InvalidValue, listed
from annik_core.pose import FloatArray
from annik_core.solver.ik_solver import IkSolver
from annik_ros.declare_parameters import declare_parameters
from annik_ros.diagnostics import ROWS_MEASURED
from annik_ros.measured_joint_positions import MeasuredJointPositions
from annik_ros.qos import reliable
from annik_ros.run_node import run_node
from annik_ros.viewer.parameters import ViewerParameters
from annik_view.meshes import link_meshes
from annik_view.page import RATE, Page
from annik_view.server import is_local, open_to_others
from annik_view.solvers import solver_for, solver_of
from annik_view.state import TRAIL, Examples, Following, ViewState
from msg_tools.conversions.pose import pose_from_array, pose_to_array
from msg_tools.topics import (
    ACCEPTED_TARGET,
    ACHIEVED_POSE,
    DIAGNOSTICS,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    TARGET_POSE,
    Topic,
)

NODE_NAME = "viewer"

#: A joint state is shown for this long [s].
_TIMEOUT = 1.0
#: Longest wait for the page to close [s].
_CLOSING = 5.0


class Viewer(Node):
    """Shows the robot where it is, in the browser; a target dragged there moves it if so chosen.

    The page has a thread of its own. What arrives is collected by the executor's thread, and
    handed over by one timer, with the lock of the page held.
    """

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        parameters = declare_parameters(self, ViewerParameters)
        plan = load_dataset(parameters.plan) if parameters.plan else None
        solver = _solver(parameters, plan)
        if not is_local(parameters.host):
            self.get_logger().warning(open_to_others(parameters.host))
        #: Done, with exit code 1, when the page fails.
        self.failed = Future()
        self._accepted: list[FloatArray] = []
        self._achieved: list[FloatArray] = []
        self._errors = dict.fromkeys((POSITION_ERROR, ORIENTATION_ERROR), math.nan)
        self._rows: frozenset[int] = frozenset()
        self._is_placed = False
        self._shown: tuple[object, ...] = ()
        is_urdf = not parameters.model and plan is None
        meshes = link_meshes(parameters.robot) if is_urdf else []
        examples = None if plan is None else Examples(plan.joint_positions, plan.poses[:, :3])
        self.page = Page(
            ViewState(solver, follows=True, examples=examples, meshes=meshes),
            host=parameters.host,
            port=parameters.port,
            drive=self._driver() if parameters.drive else None,
        )
        self._measured = MeasuredJointPositions(self, solver.robot.joint_names, _TIMEOUT)
        for topic, poses in ((ACCEPTED_TARGET, self._accepted), (ACHIEVED_POSE, self._achieved)):
            self.create_subscription(
                PoseStamped, topic.name, partial(self._on_pose, poses), reliable(TRAIL)
            )
        for topic in self._errors:
            self.create_subscription(
                Vector3Stamped, topic.name, partial(self._on_error, topic), reliable(1)
            )
        if plan is not None:
            self.create_subscription(
                DiagnosticArray,
                DIAGNOSTICS.name,
                partial(self._on_diagnostics, len(plan)),
                reliable(10),
            )
        self.create_timer(
            1.0 / RATE, self._hand_over, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._thread = threading.Thread(target=self._run_page, name="page", daemon=True)
        self._thread.start()
        self.get_logger().info(f"showing {solver.robot.name}: open {self.page.url} in a browser")

    def close(self) -> str:
        """Close the page: nothing is published any more."""
        self.page.close()
        self._thread.join(_CLOSING)
        return "page closed"

    def _run_page(self) -> None:
        try:
            self.page.run()
        except Exception:
            self.get_logger().fatal(f"the page failed: {traceback.format_exc()}")
            self.failed.set_result(1)

    def _driver(self) -> Callable[[FloatArray], None]:
        publisher = self.create_publisher(Pose, TARGET_POSE.name, reliable(1))
        return lambda target: publisher.publish(pose_from_array(target))

    def _on_pose(self, poses: list[FloatArray], message: PoseStamped) -> None:
        poses.append(pose_to_array(message.pose))

    def _on_error(self, topic: Topic, message: Vector3Stamped) -> None:
        vector = message.vector
        self._errors[topic] = math.hypot(vector.x, vector.y, vector.z)

    def _on_diagnostics(self, count: int, message: DiagnosticArray) -> None:
        for status in message.status:
            for entry in status.values:
                if entry.key == ROWS_MEASURED:
                    # Anyone may publish diagnostics.
                    with suppress(ValueError):
                        self._rows = rows_in(entry.value, count)

    def _hand_over(self) -> None:
        """Give the page what arrived since the last time, if that changes anything."""
        newest = self._measured.newest()
        seen = (
            None if newest is None else newest.joint_positions.tolist(),
            *self._errors.values(),
            self._rows,
        )
        if seen == self._shown and not self._accepted and not self._achieved:
            return
        with self.page.changing() as state:
            state.following = Following(*self._errors.values())
            if state.examples is not None:
                state.examples.measured = self._rows
            for pose in self._accepted:
                state.accepted(pose)
            for pose in self._achieved:
                state.achieved_at(pose)
            if newest is not None and self._is_placed:
                state.measured(newest.joint_positions)
            elif newest is not None:
                # The first one: the target starts at the end effector.
                state.show_joints(newest.joint_positions)
                self.page.place_gizmo()
                self._is_placed = True
        self._accepted.clear()
        self._achieved.clear()
        self._shown = seen


def _solver(parameters: ViewerParameters, plan: Dataset | None) -> IkSolver:
    if plan is not None and not parameters.model:
        return solver_for(plan.robot)
    solver = solver_of(
        parameters.model or parameters.robot,
        base_frame=parameters.base_frame or None,
        end_effector_frame=parameters.end_effector_frame or None,
    )
    if plan is not None and plan.robot.joint_names != solver.robot.joint_names:
        allowed = f"a plan for the joints {listed(solver.robot.joint_names)} of the model"
        raise InvalidValue("plan", parameters.plan, allowed)
    return solver


def main(args: list[str] | None = None) -> int:
    """Run the node; returns the exit code."""
    return run_node(
        NODE_NAME,
        Viewer,
        ViewerParameters,
        args,
        finished=lambda node: node.failed,
        finish=Viewer.close,
    )


if __name__ == "__main__":
    sys.exit(main())
