"""Serve a model to a real robot: ik_node, and what shows the robot, if asked.

The robot publishes joint_states, and follows joint_command, or what the parameters
publish_position_commands and publish_joint_trajectory add for ros2_control.
"""

from launch import LaunchDescription, LaunchDescriptionEntity

from annik_core.errors import InvalidValue
from annik_ros.launch_actions import Launch, launch_description

ARGUMENTS = (
    "model",
    "namespace",
    "params_file",
    "remappings",
    "use_sim_time",
    "autostart",
    "log_level",
    "viewer",
    "rviz",
)


def generate_launch_description() -> LaunchDescription:
    """Return the nodes, with their files in config/."""
    return launch_description(__file__, ARGUMENTS, _node)


def _node(launch: Launch) -> list[LaunchDescriptionEntity]:
    values = launch.values
    in_file = launch.file_parameters("ik_node")
    if not (values["model"] or in_file.get("model")):
        # The default is the gantry of the paper, which nobody has.
        raise InvalidValue("model", "", "the model of the robot, here or in params_file")
    given = {"model": values["model"] or None, "autostart": values["autostart"]}
    model = values["model"] or in_file.get("model")
    return [launch.node("ik_node", given), *launch.displays(model)]
