"""The command-line options that say which robot, and how an arm's frames and working box are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from annik_core.errors import AnnikError
from annik_core.robots.robot import Robot

#: Names of the options below, as a command receives them.
ROBOT_OPTIONS = ("robot", "base_frame", "end_effector_frame", "joint_box")


def robot_options(command: Any) -> Any:
    """The options of a command that works on a robot."""
    for option in reversed(
        (
            click.option(
                "--robot",
                default="gantry",
                show_default=True,
                help="Packaged robot, a definition (.yaml) or a URDF (.urdf).",
            ),
            *_frame_options(),
        )
    ):
        command = option(command)
    return command


def robot_argument(command: Any) -> Any:
    """The same, with the robot as the command's argument."""
    for option in reversed((click.argument("robot"), *_frame_options())):
        command = option(command)
    return command


def _frame_options() -> tuple[Any, ...]:
    return (
        click.option("--base-frame", help="Of an arm: the link that poses are given in."),
        click.option("--end-effector-frame", help="Of an arm: the link whose pose it is."),
        click.option(
            "--joint-box",
            multiple=True,
            metavar="JOINT=LOWER:UPPER",
            help="Of an arm: where a joint works [rad or m]; once for each joint. JOINT=VALUE "
            "locks it; the last one for a joint counts.",
        ),
    )


def chosen_robot(
    robot: str,
    base_frame: str | None,
    end_effector_frame: str | None,
    joint_box: Sequence[str],
) -> Robot:
    """The robot that the options name.

    Raises:
        RobotError: see :func:`annik_core.robots.library.load_robot`.
    """
    from annik_core.robots.library import load_robot

    return load_robot(
        Path(robot) if Path(robot).suffix else robot,
        base_frame=base_frame,
        end_effector_frame=end_effector_frame,
        joint_box=dict(map(_bounds, joint_box)) or None,
    )


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    """``JOINT=LOWER:UPPER`` or ``JOINT=VALUE``."""
    joint, equals, interval = text.rpartition("=")
    try:
        numbers = [float(part) for part in interval.split(":")]
    except ValueError:
        numbers = []
    if not joint or not equals or len(numbers) not in (1, 2):
        raise InvalidJointBox(text)
    return joint, (numbers[0], numbers[-1])


class InvalidJointBox(AnnikError):
    """An entry of a joint box can't be read."""

    def __init__(self, text: str) -> None:
        self.text = text
        super().__init__(f"--joint-box {text!r} is not of the form JOINT=LOWER:UPPER [rad or m]")
