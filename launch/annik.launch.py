"""Serve a model and stand in for its robot: ik_node and fake_robot."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return both nodes, with their files in config/."""
    # As text whatever it looks like: launch would take a name such as 1.5 for a number.
    model = {"model": ParameterValue(LaunchConfiguration("model"), value_type=str)}
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "model", default_value="", description="model file; empty: the packaged gantry"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of all nodes and topics"
            ),
            *(
                Node(
                    package="annik_ros",
                    executable=name,
                    name=name,
                    namespace=LaunchConfiguration("namespace"),
                    parameters=[
                        PathJoinSubstitution(
                            [FindPackageShare("annik_ros"), "config", f"{name}.yaml"]
                        ),
                        model,
                    ],
                    output="screen",
                )
                for name in ("ik_node", "fake_robot")
            ),
        ]
    )
