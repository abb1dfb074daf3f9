"""The designs of experiments, by name."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from annik_core.dataset import Dataset
from annik_core.errors import InvalidValue
from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.errors import UnsupportedRobot


class DesignSubject(Protocol):
    """A robot, or any other function of joint positions that a design is made for."""

    @property
    def name(self) -> str:
        """Name for error messages."""

    @property
    def joint_box(self) -> JointLimits:
        """Joint positions that the examples are chosen from."""


class Needs(Enum):
    """First argument of a design's function."""

    BOX = "joint box"
    SUBJECT = "subject, with its forward kinematics"
    ROBOT = "robot, with its workspace"
    ARM = "arm, with its chain"


@dataclass(frozen=True)
class DesignOption:
    """An integer or a switch that a design takes."""

    name: str  #: keyword argument of the design's function
    flag: str  #: name on the command line
    meaning: str  #: what it counts or does
    default: int
    minimum: int
    maximum: int


@dataclass(frozen=True)
class Design:
    """A way to choose the joint positions of the examples."""

    name: str
    description: str
    size: DesignOption  #: the option that decides the number of examples
    #: ``module.function`` in this package: ``(first argument, size, [rng], **options) -> (n,
    #: dof)`` joint positions. Loaded on first use, because most of them need libraries that are
    #: slow to load.
    function: str
    needs: Needs = Needs.BOX  #: the function's first argument
    is_drawn: bool = False  #: whether the function takes a random generator
    options: tuple[DesignOption, ...] = ()  #: options besides the size

    def joint_positions(
        self, subject: DesignSubject, size: int, rng: np.random.Generator, **options: Any
    ) -> FloatArray:
        """Joint positions ``(n, dof)``; locked joints keep their position."""
        module, _, name = self.function.rpartition(".")
        function = getattr(import_module(f"annik_training.designs.{module}"), name)
        drawn_from = (rng,) if self.is_drawn else ()
        rows: FloatArray
        if self.needs is not Needs.BOX:
            first = subject if self.needs is Needs.SUBJECT else _robot_of(subject)
            rows = function(first, size, *drawn_from, **options)
            return rows
        box, free = subject.joint_box, subject.joint_box.free
        names = [box.joint_names[joint] for joint in free]
        free_box = JointLimits.from_bounds(names, box.lower[free], box.upper[free])
        moved = function(free_box, size, *drawn_from, **options)
        rows = np.tile(box.lower, (len(moved), 1))
        rows[:, free] = moved
        return rows


_PAPER_ROWS = "the rows as the paper counts them (104, 194)"
_LEVELS = "fractions of roll, pitch and yaw"
_STEPS = DesignOption("steps", "--steps", "steps of each sweep (j)", 6, 1, 1000)


def _examples(maximum: int) -> DesignOption:
    return DesignOption("examples", "--examples", "number of examples", 100, 1, maximum)


DESIGNS: Mapping[str, Design] = {
    design.name: design
    for design in (
        Design(
            "thirty_phase",
            "joints swept alone and together in 30 phases: the paper's, Table 1",
            _STEPS,
            "thirty_phase_design.thirty_phase_design",
            options=(
                DesignOption("keep_paper_rows", "--paper-rows", _PAPER_ROWS, False, False, True),
            ),
        ),
        Design(
            "thirty_phase_plus",
            "the paper's, and the pairs of joints without which it is blind to interactions",
            _STEPS,
            "thirty_phase_plus_design.thirty_phase_plus_design",
        ),
        Design(
            "workspace_grid",
            "a regular grid of poses: the paper's 'known method', Table 7",
            DesignOption(
                "positions_per_axis", "--positions-per-axis", "grid positions per axis", 4, 2, 100
            ),
            "workspace_grid_design.workspace_grid_design",
            Needs.ROBOT,
            options=(
                DesignOption("orientation_levels", "--orientation-levels", _LEVELS, 1, 1, 100),
            ),
        ),
        Design(
            "central_composite",
            "corners, face centres and centre of the joint box: Box and Wilson 1951",
            DesignOption(
                "shells", "--shells", "nested boxes of corners and face centres", 1, 1, 100
            ),
            "central_composite_design.central_composite_design",
        ),
        Design(
            "latin_hypercube",
            "one example in each slice of every joint, otherwise at random",
            _examples(1_000_000),
            "sampling_designs.latin_hypercube_design",
            is_drawn=True,
        ),
        Design(
            "sobol",
            "a scrambled Sobol sequence: evenly spread, and can be continued",
            _examples(1_000_000),
            "sampling_designs.sobol_design",
            is_drawn=True,
        ),
        Design(
            "random",
            "independent and uniform",
            _examples(1_000_000),
            "sampling_designs.random_design",
            is_drawn=True,
        ),
        Design(
            "active",
            "chosen batch by batch, where networks fitted to the examples so far disagree",
            # Each batch fits networks to all examples before it: thousands would take hours.
            _examples(2000),
            "active_design.active_design",
            Needs.SUBJECT,
            is_drawn=True,
        ),
        Design(
            "identifiability",
            "where the errors of a real arm show best, for measuring it: D-optimal",
            _examples(1000),
            "identifiability_design.identifiability_design",
            Needs.ARM,
            is_drawn=True,
        ),
    )
}


def design_names() -> tuple[str, ...]:
    """Names of all designs of experiments."""
    return tuple(DESIGNS)


def find_design(name: str) -> Design:
    """The design with this name.

    Raises:
        InvalidValue: listing the known names.
    """
    if name not in DESIGNS:
        raise InvalidValue("design", name, ", ".join(DESIGNS))
    return DESIGNS[name]


def check_subject(name: str, subject: DesignSubject) -> None:
    """Refuse a subject that no design of this name can be made for, whatever its size.

    Raises:
        InvalidValue: if there is no such design.
        UnsupportedRobot: with the reason.
    """
    design = find_design(name)
    purpose = f"design {name}"
    if len(subject.joint_box.free) == 0:
        raise UnsupportedRobot(purpose, subject.name, "all its joints are locked")
    robot = _robot_of(subject)
    if design.needs is Needs.ROBOT and robot is None:
        raise UnsupportedRobot(purpose, subject.name, "it has no workspace to divide")
    if design.needs is Needs.ARM and (robot is None or robot.kind != "arm"):
        raise UnsupportedRobot(purpose, subject.name, "it is no arm with a URDF")


def make_design(
    subject: DesignSubject,
    design: str,
    size: int,
    seed: int = 0,
    options: Mapping[str, Any] | None = None,
) -> FloatArray:
    """Joint positions ``(n, dof)`` [rad or m] of a design of experiments, in the joint box.

    ``size`` is the value of the design's size option, such as the number of examples, and
    ``options`` are its others. The seed is that of a random design.

    Raises:
        InvalidValue: if the name, the size or an option is not allowed.
        UnsupportedRobot: if the design can't be made for this subject.
    """
    chosen = find_design(design)
    given = dict(options or {})
    known = {option.name: option for option in chosen.options}
    if not given.keys() <= known.keys():
        unknown = ", ".join(sorted(given.keys() - known.keys()))
        allowed = ", ".join((chosen.size.name, *known))
        raise InvalidValue(f"option of design {design}", unknown, allowed)
    check_subject(design, subject)
    for option, value in ((chosen.size, size), *((known[name], given[name]) for name in given)):
        if not option.minimum <= value <= option.maximum:
            allowed = f"{option.minimum} to {option.maximum}"
            raise InvalidValue(f"{option.name} of design {design}", value, allowed)
    rows = chosen.joint_positions(subject, size, np.random.default_rng(seed), **given)
    # Rounding must not leave the box.
    box = subject.joint_box
    return np.clip(rows, box.lower, box.upper)


def _robot_of(subject: DesignSubject) -> Robot | None:
    """The robot that a subject is, or whose inverse kinematics it is."""
    robot = getattr(subject, "robot", subject)
    return robot if isinstance(robot, Robot) else None


def generate_dataset(
    robot: Robot, design: str, size: int, seed: int = 0, options: Mapping[str, Any] | None = None
) -> Dataset:
    """Examples of a design of experiments, with the poses of the robot's forward kinematics.

    Arguments and errors are those of :func:`annik_training.make_design`.
    """
    joint_positions = make_design(robot, design, size, seed, options)
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, design, {"size": size, **(options or {})}, seed)


def random_dataset(robot: Robot, box: JointLimits, examples: int, seed: int) -> Dataset:
    """Uniformly random joint positions in a box, for evaluation."""
    joint_positions = box.sample(examples, np.random.default_rng(seed))
    poses = robot.forward_kinematics.poses(joint_positions)
    return Dataset(robot, joint_positions, poses, "random", {"size": examples}, seed)
