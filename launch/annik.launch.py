"""Serve a model and simulate its robot: ik_node and fake_robot; and show it, if asked."""

from launch import LaunchDescription, LaunchDescriptionEntity

from annik_ros.launch_actions import Launch, launch_description

ARGUMENTS = (
    "model",
    "namespace",
    "params_file",
    "remappings",
    "use_sim_time",
    "log_level",
    "viewer",
    "rviz",
)


def generate_launch_description() -> LaunchDescription:
    """Return both nodes, with their files in config/."""
    return launch_description(__file__, ARGUMENTS, _nodes)


def _nodes(launch: Launch) -> list[LaunchDescriptionEntity]:
    launch.file_parameters("ik_node", "fake_robot")
    model = launch.values["model"] or None
    nodes = [launch.node(name, {"model": model}) for name in ("ik_node", "fake_robot")]
    return [*nodes, *launch.displays(model)]
