"""Serve a model to a real robot: ik_node alone.

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
)


def generate_launch_description() -> LaunchDescription:
    """Return the node, with its file in config/."""
    return launch_description(__file__, ARGUMENTS, _node)


def _node(launch: Launch) -> list[LaunchDescriptionEntity]:
    values = launch.values
    in_file = launch.file_parameters("ik_node")
    if not (values["model"] or in_file.get("model")):
        # The default is the gantry of the paper, which nobody has.
        raise InvalidValue("model", "", "the model of the robot, here or in params_file")
    return [
        launch.node(
            "ik_node", {"model": values["model"] or None, "autostart": values["autostart"]}
        )
    ]
