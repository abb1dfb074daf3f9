"""The whole demo: ik_node, fake_robot, a path of targets; if asked, a bag and what shows it.

Everything ends when the path has been followed, or could not be: then with exit code 1.
"""

from launch import LaunchDescription, LaunchDescriptionEntity

from annik_core.target_paths import PathKind
from annik_ros.launch_actions import Launch, ends_the_launch, launch_description

ARGUMENTS = ("model", "path", "csv_file", "rate", "loops", "bag", "namespace", "viewer", "rviz")

# The last results have arrived when their publisher ends, but perhaps not yet in the bag [s].
END_DELAY = 1.0


def generate_launch_description() -> LaunchDescription:
    """Return the demo, with its arguments."""
    return launch_description(__file__, ARGUMENTS, _nodes)


def _nodes(launch: Launch) -> list[LaunchDescriptionEntity]:
    values = launch.values
    model = values["model"] or None
    parameters: dict[str, dict[str, object]] = {
        # A controller wants the newest target, a demo all of them.
        "ik_node": {"model": model, "queue_depth": 1000},
        # A path from a file may begin anywhere: the robot is nowhere before the first command.
        "fake_robot": {
            "model": model,
            "joint_state_rate": 0.0 if values["path"] is PathKind.CSV else None,
        },
        "target_publisher": {
            "model": model,
            "path": values["path"].value,
            "csv_file": values["csv_file"],
            "rate": values["rate"],
            "loops": values["loops"],
            "exit_when_done": True,
            # The launch ends with any node, so that a slow machine may take its time.
            "wait_timeout": 300.0,
            "wait_for_subscribers": 2 if values["bag"] else 1,
            "expected_results": "achieved",
        },
    }
    if values["bag"]:
        parameters["bag_recorder"] = {"output": values["bag"]}
    return [
        launch.node(
            name,
            given,
            ends_the_launch(name, may_end=name == "target_publisher", delay=END_DELAY),
        )
        for name, given in parameters.items()
    ] + launch.displays(model)
