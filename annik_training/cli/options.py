"""Options that several commands share: robot, design of experiments, fit, files and seed."""

from collections.abc import Iterable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from annik_core.dataset import COMPUTED, Dataset, load_dataset
from annik_core.errors import InvalidValue
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.settings import Setting, settings_of
from annik_training.calibration.errors import NotMeasured
from annik_training.defaults import DEFAULT_EVALUATION_POSES, DEFAULTS, defaults_of
from annik_training.designs.registry import (
    DESIGNS,
    DesignOption,
    design_names,
    find_design,
    generate_dataset,
)
from annik_training.fitting.options import FitOptions

FILE = click.Path(dir_okay=False, path_type=Path)
PATH = click.Path(path_type=Path)
SEED = click.option(
    "--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of all randomness."
)
EVALUATION_POSES = click.option(
    "--evaluation-poses",
    type=click.IntRange(1),
    default=DEFAULT_EVALUATION_POSES,
    show_default=True,
    help="Number of random poses of the evaluation.",
)
SUMMARY = click.option("--summary", type=FILE, help="Also write the results as JSON.")
#: The designs of experiments and the default one, in words.
DESIGN_NAMES = ", ".join(design_names())
DEFAULT_DESIGN = "; ".join(
    f"{kind}: {usual.design} with {DESIGNS[usual.design].size.flag} {usual.size}"
    for kind, usual in DEFAULTS.items()
)

_ROBOT_OPTIONS = ("robot", "base_frame", "end_effector_frame", "joint_box")
_FIT_FLAGS = {
    field.name: field.metadata["flag"] for field in fields(FitOptions) if "flag" in field.metadata
}
#: Names of the options of :func:`fit_options`, as a command receives them.
FIT_NAMES = tuple(_FIT_FLAGS)


def robot_options(command: Any) -> Any:
    """Options of a command that works on a robot."""
    robot = click.option(
        "--robot",
        default="gantry",
        show_default=True,
        help="Packaged robot, a definition (.yaml) or a URDF (.urdf).",
    )
    return _with_options(command, (robot, *_frame_options()))


def robot_argument(command: Any) -> Any:
    """The same, with the robot as the command's argument."""
    return _with_options(command, (click.argument("robot"), *_frame_options()))


def nominal_options(command: Any) -> Any:
    """Options of a command that works on measurements: the arm as described, or none."""
    robot = click.option(
        "--robot",
        "--nominal",
        "robot",
        help="The arm as described: packaged, a definition or URDF; default: the dataset's.",
    )
    return _with_options(command, (robot, *_frame_options()))


def chosen_robot(choices: dict[str, Any]) -> Robot:
    """Load the robot that the options name; they are taken out of the choices.

    Raises:
        RobotError: see :func:`annik_core.robots.library.load_robot`.
    """
    robot, base_frame, end_effector_frame, joint_box = (
        choices.pop(name) for name in _ROBOT_OPTIONS
    )
    return load_robot(
        robot,
        base_frame=base_frame,
        end_effector_frame=end_effector_frame,
        joint_box=dict(map(_bounds, joint_box)) or None,
    )


def design_options(command: Any) -> Any:
    """Sizes and options of the designs, as the registry has them."""
    users: dict[str, list[str]] = {}
    known: dict[str, DesignOption] = {}
    for design in DESIGNS.values():
        for option in (design.size, *design.options):
            users.setdefault(option.flag, []).append(design.name)
            known[option.flag] = option
    return _with_options(
        command,
        (
            click.option(
                flag,
                option.name,
                type=bool if option.default is False else int,
                is_flag=option.default is False,
                default=None,
                help=f"{', '.join(users[flag])}: {option.meaning}"
                + ("." if option.default is False else f" (default {option.default})."),
            )
            for flag, option in known.items()
        ),
    )


def chosen_dataset(seed: int, choices: dict[str, Any]) -> Dataset:
    """Compute the examples that the options of robot and design ask for."""
    robot = chosen_robot(choices)
    named = choices.pop("design")
    usual = defaults_of(robot)
    design = find_design(named or usual.design)
    # By identity: 0 equals False, but was given.
    given = {
        name: value for name, value in choices.items() if value is not None and value is not False
    }
    size = given.pop(design.size.name, None)
    if size is None:
        size = design.size.default if named else usual.size
        click.echo(f"{design.name}: {design.size.flag} is {size}, the default")
    return generate_dataset(robot, design.name, size, seed, given)


def fit_options(command: Any) -> Any:
    """Options of the fit, as :class:`FitOptions` has them; left out, as suits the robot."""
    options = (option for option in settings_of(FitOptions) if option.name in _FIT_FLAGS)
    return _with_options(command, map(_fit_option, options))


def chosen_fit(robot: Robot, seed: int, choices: dict[str, Any]) -> FitOptions:
    """The robot's default options of the fit, changed by the choices."""
    changes = {name: value for name, value in choices.items() if value is not None}
    return replace(defaults_of(robot).fit, seed=seed, **changes)


def measured_dataset(path: Path) -> Dataset:
    """Load measured poses; computed ones would calibrate a robot that does not exist.

    Raises:
        NotMeasured: if the poses were computed.
    """
    dataset = load_dataset(path)
    if dataset.source == COMPUTED:
        raise NotMeasured(path)
    return dataset


def _with_options(command: Any, options: Iterable[Any]) -> Any:
    for option in reversed(list(options)):
        command = option(command)
    return command


def _frame_options() -> tuple[Any, ...]:
    return (
        click.option("--base-frame", help="Of an arm: the link in which poses are given."),
        click.option("--end-effector-frame", help="Of an arm: the link whose pose is given."),
        click.option(
            "--joint-box",
            multiple=True,
            metavar="JOINT=LOWER:UPPER",
            help="Of an arm: interval of a joint [rad or m, or with a unit: -90deg:90deg, "
            "0:250mm], inside its limits; once for each joint. JOINT=VALUE locks it; the last "
            "one for a joint counts.",
        ),
    )


def _bounds(text: str) -> tuple[str, tuple[str, str]]:
    """``JOINT=LOWER:UPPER`` or ``JOINT=VALUE``, each with a unit or without."""
    joint, equals, interval = text.rpartition("=")
    bounds = interval.split(":")
    if not joint or not equals or len(bounds) not in (1, 2):
        allowed = "JOINT=LOWER:UPPER or JOINT=VALUE [rad or m, or a unit such as 90deg]"
        raise InvalidValue("--joint-box", text, allowed)
    return joint, (bounds[0], bounds[-1])


def _fit_option(option: Setting) -> Any:
    """The command-line option of a field of :class:`FitOptions`."""
    flag = _FIT_FLAGS[option.name]
    defaults = "; ".join(
        f"{kind}: {_shown(getattr(usual.fit, option.name))}" for kind, usual in DEFAULTS.items()
    )
    settings: dict[str, Any] = {"type": type(option.default)}
    if isinstance(option.default, bool):
        flag = f"{flag}/--no-{flag.removeprefix('--')}"
        settings = {"default": None}
    elif isinstance(option.default, tuple):
        settings = {"callback": _integers}
    elif option.choices:
        settings = {"type": click.Choice(option.choices)}
    sentence = f"{option.description} Default: {defaults}."
    return click.option(flag, option.name, help=sentence, **settings)


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ",".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _integers(_: click.Context, __: click.Parameter, text: str | None) -> tuple[int, ...] | None:
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not a list of numbers like 20,20") from error
