"""Actions of the launch files. launch is imported when used, since it is not everywhere."""

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from annik_core.errors import AnnikError
from annik_core.installation import default_model_path, share_directory
from annik_ros.launch_arguments import ARGUMENTS, check_names, checked_arguments, node_parameters
from msg_tools.topics import ACCEPTED_TARGET, ACHIEVED_POSE, ROBOT_DESCRIPTION

if TYPE_CHECKING:
    from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
    from launch.events.process import ProcessExited

Actions = list["LaunchDescriptionEntity"]
OnExit = Callable[["ProcessExited", "LaunchContext"], Actions | None]


class NodeEnded(AnnikError):
    """A node ended that the others need; a negative exit code is the signal that killed it."""

    def __init__(self, node: str, exit_code: int) -> None:
        self.node = node
        self.exit_code = exit_code
        super().__init__(f"{node} ended with exit code {exit_code}")


class Launch:
    """The checked arguments of a launch file, and the nodes that it starts with them."""

    def __init__(self, context: "LaunchContext", names: Sequence[str]) -> None:
        configurations = context.launch_configurations
        self.values = checked_arguments({name: configurations[name] for name in names})
        namespace: str = self.values["namespace"]
        if not namespace.startswith("/"):
            namespace = f"{configurations.get('ros_namespace', '')}/{namespace}"
        self._namespace = [part for part in namespace.split("/") if part]

    def file_parameters(self, *nodes: str) -> dict[str, Any]:
        """What the parameter file has for any of these nodes; raise AnnikError if nothing."""
        file = self.values["params_file"]
        names = ["/" + "/".join([*self._namespace, node]) for node in nodes]
        return node_parameters(file, names) if file else {}

    def displays(self, model: str | None) -> "Actions":
        """What shows the robot of a model, as far as asked for: the page in the browser, RViz.

        Nothing ends with them: who closes a window may want the robot to go on.
        """
        actions: Actions = []
        if self.values["viewer"]:
            actions.append(self.node("viewer", {"model": model}, _ends_alone))
        if self.values["rviz"]:
            from launch_ros.actions import Node

            from annik_core.model.artifact import load_model

            layout = share_directory() / "config" / "annik.rviz"
            frame = load_model(model or default_model_path()).robot.base_frame
            topics = ("tf", "tf_static", ROBOT_DESCRIPTION, ACCEPTED_TARGET, ACHIEVED_POSE)
            names = [topic if isinstance(topic, str) else topic.name for topic in topics]
            actions.append(
                Node(
                    package="rviz2",
                    executable="rviz2",
                    namespace=self.values["namespace"],
                    arguments=["-d", str(layout), "-f", frame],
                    parameters=[{"use_sim_time": bool(self.values.get("use_sim_time"))}],
                    # The layout names them without a namespace.
                    remappings=[(f"/{name}", name) for name in names],
                    on_exit=_ends_alone,
                )
            )
        return actions

    def node(
        self,
        name: str,
        parameters: Mapping[str, object] | None = None,
        on_exit: "OnExit | None" = None,
    ) -> "LaunchDescriptionEntity":
        """A node of annik, with its file in ``config/``, the parameter file and these parameters.

        Parameters that are None are not given. By default everything ends with the node.
        """
        from launch_ros.actions import Node
        from launch_ros.parameter_descriptions import ParameterValue

        given = {"use_sim_time": self.values.get("use_sim_time"), **(parameters or {})}
        files = [str(share_directory() / "config" / f"{name}.yaml")]
        if self.values.get("params_file"):
            files.append(self.values["params_file"])
        level = self.values.get("log_level")
        return Node(
            package="annik_ros",
            executable=name,
            name=name,
            namespace=self.values["namespace"],
            # As text whatever it looks like: launch would take a name such as 1.5 for a number.
            parameters=[
                *files,
                {
                    key: ParameterValue(value, value_type=str) if isinstance(value, str) else value
                    for key, value in given.items()
                    if value is not None
                },
            ],
            remappings=self.values.get("remappings", []),
            ros_arguments=["--log-level", level] if level else [],
            output="screen",
            on_exit=on_exit or ends_the_launch(name),
        )


def launch_description(
    file: str, names: Sequence[str], make: Callable[[Launch], Actions]
) -> "LaunchDescription":
    """A launch file with these arguments, which are checked before anything starts.

    ``make`` makes its actions, and may raise an :class:`AnnikError`.
    """
    from launch import LaunchDescription
    from launch.actions import DeclareLaunchArgument, OpaqueFunction

    def actions(context: "LaunchContext") -> Actions:
        try:
            # In a launch file that includes this one, names may be alike.
            if any(Path(word).name == Path(file).name for word in sys.argv):
                check_names(context.argv, names)
            return make(Launch(context, names))
        except AnnikError as error:
            return failure(error)

    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(
                    name,
                    default_value=ARGUMENTS[name].default,
                    description=ARGUMENTS[name].meaning,
                )
                for name in names
            ),
            OpaqueFunction(function=actions),
        ]
    )


def failure(error: AnnikError) -> Actions:
    """Actions that end the launch with exit code 1 and the error.

    Raised at once, it would leave behind the processes of launch files that were included before.
    """
    from launch.actions import OpaqueFunction, TimerAction

    def fail(_: "LaunchContext") -> NoReturn:
        raise error

    return [TimerAction(period=0.0, actions=[OpaqueFunction(function=fail)])]


def _ends_alone(_event: "ProcessExited", _context: "LaunchContext") -> None:
    """On the end of a process: nothing."""


def ends_the_launch(node: str, *, may_end: bool = True, delay: float = 0.0) -> OnExit:
    """What to do when a node ends: end all, with exit code 1 unless it may end and its is 0.

    Then the others have the delay [s] to finish.
    """

    def on_exit(event: "ProcessExited", context: "LaunchContext") -> Actions | None:
        from launch.actions import Shutdown, TimerAction

        # Whoever ends the launch ends its processes too, and their exit codes mean nothing then.
        if context.is_shutdown:
            return None
        if event.returncode == 0 and may_end:
            end = Shutdown(reason=f"{node} has ended")
            return [TimerAction(period=delay, actions=[end])]
        # What is raised ends the launch with exit code 1; a Shutdown would give it 0.
        raise NodeEnded(node, event.returncode)

    return on_exit
