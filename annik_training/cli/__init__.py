"""The ``annik`` command line: the file of a command is loaded when the command is called."""

import sys
from collections.abc import Mapping
from importlib import import_module

from annik_core.errors import AnnikError, missing_dependency, one_line

try:
    import click

    from annik_core.installation import annik_version
except ImportError as error:
    sys.exit(f"annik: {missing_dependency(error, 'annik')}")

#: Commands in the order of the work, and what ``annik --help`` says of each without loading it.
COMMANDS: Mapping[str, str] = {
    "robot": "Show a robot's joints, frames and joint box, and the branches in the box.",
    "design": "Choose the joint positions of the examples by a design of experiments.",
    "train": "Train a network on few examples and write it as a model file.",
    "calibrate": "Calibrate an arm from measurements, and write its model file, its URDF, or "
    "both.",
    "evaluate": "Measure a model's errors at random poses, or at measured ones.",
    "info": "Check a model file and print its metadata.",
    "export-urdf": "Write the URDF of a model's robot, for RViz and robot_state_publisher.",
    "view": "Show a robot in the browser, with a target to drag.",
    "report": "Report the tracking error in a bag: tables here, plots in report.html.",
    "doctor": "Check this installation: libraries, ROS 2, models, a target over DDS.",
}
_RENAMED = {"fit": "calibrate"}
#: Files of commands that have none of their own name.
_FILES = dict.fromkeys(("export-urdf", "info"), "model_files")


class _LazyGroup(click.Group):
    """Imports the file of a command when the command is called, not for the list of commands."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = import_module(f"annik_training.cli.{_FILES.get(cmd_name, cmd_name)}")
        command: click.Command = getattr(module, cmd_name.replace("-", "_"))
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] in _RENAMED:
            ctx.fail(f"No such command {args[0]!r}. Did you mean {_RENAMED[args[0]]!r}?")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=_LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(annik_version(), prog_name="annik")
def cli() -> None:
    """Learned inverse kinematics for ROS 2, from few examples."""


def main() -> None:
    """Run the command line; an error of annik is one line on stderr and exit code 1."""
    problem: Exception
    try:
        cli(standalone_mode=True)
        return
    except AnnikError as error:
        problem = error
    except ImportError as error:
        problem = missing_dependency(error, "this command")
    click.echo(f"annik: {one_line(problem)}", err=True)
    sys.exit(1)
