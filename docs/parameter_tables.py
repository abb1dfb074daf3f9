"""The parameter tables of all nodes. Needs no ROS."""

from __future__ import annotations

from annik_ros.bag_recorder.parameters import BagRecorderParameters
from annik_ros.example_collector.parameters import ExampleCollectorParameters
from annik_ros.fake_robot.parameters import FakeRobotParameters
from annik_ros.ik_node.parameters import IkNodeParameters
from annik_ros.parameters import Parameter, parameter_table
from annik_ros.target_publisher.parameters import TargetPublisherParameters
from annik_ros.viewer.parameters import ViewerParameters

#: The parameter table of each node, by the node's name.
PARAMETER_TABLES: dict[str, tuple[Parameter, ...]] = {
    "ik_node": parameter_table(IkNodeParameters),
    "fake_robot": parameter_table(FakeRobotParameters),
    "target_publisher": parameter_table(TargetPublisherParameters),
    "bag_recorder": parameter_table(BagRecorderParameters),
    "example_collector": parameter_table(ExampleCollectorParameters),
    "viewer": parameter_table(ViewerParameters),
}
