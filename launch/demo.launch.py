"""The whole demo: ik_node, fake_robot, a path of targets and, if asked, a bag.

Everything ends when the path has been followed, or could not be: then with an error and a non-zero
exit code.
"""

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity, logging
from launch.actions import (
    DeclareLaunchArgument,
    IncludeLaunchDescription,
    OpaqueFunction,
    RegisterEventHandler,
    Shutdown,
    TimerAction,
)
from launch.event_handlers import OnProcessExit
from launch.events.process import ProcessExited
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

# The targets wait for their subscribers, but not for those of the commands that follow [s].
START_DELAY = 2.0
# The last target is delivered when its publisher ends; its answer is still on the way [s].
END_DELAY = 1.0


def generate_launch_description() -> LaunchDescription:
    """Return the demo, with its arguments."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "model", default_value="", description="model file; empty: the packaged gantry"
            ),
            DeclareLaunchArgument(
                "path",
                default_value="diagonal",
                choices=["diagonal", "line", "circle", "csv"],
                description="path to follow; its details are in config/target_publisher.yaml",
            ),
            DeclareLaunchArgument("rate", default_value="50.0", description="targets a second"),
            DeclareLaunchArgument(
                "loops", default_value="1", description="times to follow the path; 0: for ever"
            ),
            DeclareLaunchArgument(
                "bag", default_value="", description="folder of a bag to record; empty: none"
            ),
            DeclareLaunchArgument(
                "namespace", default_value="", description="namespace of all nodes and topics"
            ),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(_packaged("launch", "annik.launch.py")),
                launch_arguments={
                    name: LaunchConfiguration(name) for name in ("model", "namespace")
                }.items(),
            ),
            OpaqueFunction(function=_targets_and_bag),
        ]
    )


def _targets_and_bag(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    value = context.launch_configurations
    namespace = value["namespace"]
    bag = value["bag"]
    target_publisher = Node(
        package="annik_ros",
        executable="target_publisher",
        name="target_publisher",
        namespace=namespace,
        parameters=[
            _packaged("config", "target_publisher.yaml"),
            {
                "path": value["path"],
                "rate": float(value["rate"]),
                "loops": int(value["loops"]),
                "exit_when_done": True,
                "wait_for_subscribers": 2 if bag else 1,
            },
        ],
        output="screen",
    )
    bag_recorder = Node(
        package="annik_ros",
        executable="bag_recorder",
        name="bag_recorder",
        namespace=namespace,
        parameters=[{"output": ParameterValue(bag, value_type=str)}],
        output="screen",
    )
    return [
        *([bag_recorder] if bag else []),
        TimerAction(period=START_DELAY, actions=[target_publisher]),
        RegisterEventHandler(OnProcessExit(target_action=target_publisher, on_exit=_end)),
    ]


class PathNotFollowed(Exception):
    """The publisher of the targets could not do its job."""


def _end(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity] | None:
    if event.returncode == 0:
        reason = "the path has been followed"
        return [TimerAction(period=END_DELAY, actions=[Shutdown(reason=reason)])]
    # Whoever ends the launch ends its processes too, and their exit codes mean nothing then.
    if context.is_shutdown:
        return None
    problem = f"target_publisher ended with exit code {event.returncode}"
    logging.get_logger("demo").error(f"the path has not been followed: {problem}")
    # What an action raises ends the launch and gives it exit code 1; a Shutdown would give it 0.
    raise PathNotFollowed(problem)


def _packaged(folder: str, file: str) -> PathJoinSubstitution:
    return PathJoinSubstitution([FindPackageShare("annik_ros"), folder, file])
