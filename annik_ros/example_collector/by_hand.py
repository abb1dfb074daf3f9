"""Recording of an arm that a person guides, on the call of a service."""

import time
from typing import Final

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from annik_core.collection.by_hand import HandGuided
from annik_core.errors import AnnikError, one_line
from annik_core.files import expanded
from annik_ros.example_collector.parameters import ExampleCollectorParameters
from annik_ros.measured_joint_positions import MeasuredJointPositions

#: The service that records where the arm is.
RECORD: Final = "~/record"
#: Period of looks at the joint positions [s].
_PERIOD: Final = 0.02


class HandGuidedRecording:
    """Reads joint states, commands nothing, and adds a row to the file of a hole for each call."""

    def __init__(self, node: Node, options: ExampleCollectorParameters) -> None:
        robot, settings = options.guided_robot, options.settings
        self._node = node
        self._guided = HandGuided(
            expanded(options.by_hand),
            robot.joint_names,
            settings.still_tolerance,
            settings.settle_time,
        )
        self._measured = MeasuredJointPositions(
            node, robot.joint_names, settings.measurement_timeout
        )
        node.create_service(Trigger, RECORD, self._on_record)
        node.create_timer(_PERIOD, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        node.get_logger().info(
            f"records robot {robot.name}, guided by hand, from {self._measured.topic_name} on "
            f"calls of {node.resolve_service_name(RECORD)}: {self.progress()}"
        )

    def progress(self) -> str:
        """How much is recorded, and which joints to move more."""
        return self._guided.progress()

    def _look(self) -> None:
        newest = self._measured.newest()
        positions = None if newest is None else newest.joint_positions
        self._guided.update(time.monotonic(), positions)

    def _on_record(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.message, response.success = self._guided.record(), True
        except (AnnikError, OSError) as error:
            response.message = one_line(error)
        log = self._node.get_logger()
        if response.success:
            log.info(response.message)
        else:
            log.warning(response.message)
        return response
