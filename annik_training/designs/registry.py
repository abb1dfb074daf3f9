"""The designs of experiments, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.designs import (
    central_composite_design,
    sampling_designs,
    thirty_phase_design,
    thirty_phase_plus_design,
    workspace_grid_design,
)
from annik_training.designs.errors import DesignError, UnknownDesign, UnsupportedRobotForDesign
from annik_training.designs.free_joints import free_box, with_locked_joints


class DesignSubject(Protocol):
    """What a design of experiments is made for: a robot, or any other function of joints."""

    @property
    def name(self) -> str:
        """What to call it in an error."""
        ...

    @property
    def joint_box(self) -> JointLimits:
        """Where the examples are chosen from."""
        ...


@dataclass(frozen=True)
class Design:
    """A way to choose joint positions for the examples.

    Attributes:
        name: what it is called on the command line.
        size_option: what the size is called on the command line.
        size_means: what the size counts.
        default_size: the size where none is asked for.
        description: one line.
        options: names of what can be set besides the size.
        make: ``(subject, size, rng, **options) -> (n, dof)`` joint positions inside the subject's
            joint box; the same for the same seed. Locked joints stay where they are, and the
            others are moved as if these were all.
        arms_only: whether it needs the kinematics of an arm.
    """

    name: str
    size_option: str
    size_means: str
    default_size: int
    description: str
    options: tuple[str, ...]
    make: Callable[..., FloatArray]
    arms_only: bool = False

    @property
    def size_flag(self) -> str:
        """The size's option as it is typed."""
        return f"--{self.size_option.replace('_', '-')}"


def _in_box(
    design: Callable[..., FloatArray], *, is_drawn: bool = False
) -> Callable[..., FloatArray]:
    """A design that needs the joint box, and randomness if it is drawn."""

    def make(
        subject: DesignSubject, size: int, rng: np.random.Generator, **options: Any
    ) -> FloatArray:
        box = subject.joint_box
        drawn_from = (rng,) if is_drawn else ()
        return with_locked_joints(design(free_box(box), size, *drawn_from, **options), box)

    return make


def _in_workspace(name: str, design: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    """A design of poses, which needs a whole robot."""

    def make(
        subject: DesignSubject, size: int, rng: np.random.Generator, **options: Any
    ) -> FloatArray:
        # The inverse kinematics of a robot, as a system to learn, has it.
        robot = getattr(subject, "robot", subject)
        if not isinstance(robot, Robot):
            raise UnsupportedRobotForDesign(name, subject.name, "it has no workspace to divide")
        return design(robot, size, **options)

    return make


def _active(
    subject: DesignSubject, size: int, rng: np.random.Generator, **options: Any
) -> FloatArray:
    """The adaptive design, which learns from its examples as it goes."""
    # Only this one needs torch.
    from annik_training.designs.active_design import NAME, active_design
    from annik_training.fitting.problem import InverseKinematicsSystem

    system: Any = InverseKinematicsSystem(subject) if isinstance(subject, Robot) else subject
    if not hasattr(system, "inputs"):
        raise UnsupportedRobotForDesign(NAME, subject.name, "it has no forward kinematics")
    return active_design(system, size, rng, **options)


def _identifiability(
    subject: DesignSubject, size: int, rng: np.random.Generator, **options: Any
) -> FloatArray:
    """The design for learning a real arm, which needs its kinematics."""
    from annik_training.designs.identifiability_design import identifiability_design

    return identifiability_design(_robot_of(subject), size, rng, **options)


def _robot_of(subject: DesignSubject) -> Any:
    """The robot that a subject is, or is the inverse kinematics of; else the subject."""
    return getattr(subject, "robot", subject)


_STEPS = ("steps", "steps of each sweep (j)", 6)
_EXAMPLES = ("examples", "number of examples", 100)

DESIGNS: Mapping[str, Design] = {
    design.name: design
    for design in (
        Design(
            thirty_phase_design.NAME,
            *_STEPS,
            "joints swept alone and together in 30 phases: the paper's, Table 1",
            ("keep_paper_rows",),
            _in_box(thirty_phase_design.thirty_phase_design),
        ),
        Design(
            thirty_phase_plus_design.NAME,
            *_STEPS,
            "the paper's, and the pairs of joints without which it is blind to interactions",
            (),
            _in_box(thirty_phase_plus_design.thirty_phase_plus_design),
        ),
        Design(
            workspace_grid_design.NAME,
            "positions_per_axis",
            "grid positions per axis",
            4,
            "a regular grid of poses: the paper's 'known method', Table 7",
            ("orientation_levels",),
            _in_workspace(workspace_grid_design.NAME, workspace_grid_design.workspace_grid_design),
        ),
        Design(
            central_composite_design.NAME,
            "shells",
            "nested boxes of corners and face centres",
            1,
            "corners, face centres and centre of the joint box: Box and Wilson 1951",
            (),
            _in_box(central_composite_design.central_composite_design),
        ),
        Design(
            "latin_hypercube",
            *_EXAMPLES,
            "one example in each slice of every joint, otherwise at random",
            (),
            _in_box(sampling_designs.latin_hypercube_design, is_drawn=True),
        ),
        Design(
            "sobol",
            *_EXAMPLES,
            "a scrambled Sobol sequence: evenly spread, and can be continued",
            (),
            _in_box(sampling_designs.sobol_design, is_drawn=True),
        ),
        Design(
            "random",
            *_EXAMPLES,
            "independent and uniform",
            (),
            _in_box(sampling_designs.random_design, is_drawn=True),
        ),
        Design(
            "active",
            *_EXAMPLES,
            "chosen one batch after another, where networks fitted to the others disagree",
            (),
            _active,
        ),
        Design(
            "identifiability",
            *_EXAMPLES,
            "where the errors of a real arm show best, for measuring it: D-optimal",
            (),
            _identifiability,
            arms_only=True,
        ),
    )
}


def find_design(name: str) -> Design:
    """The design with this name.

    Raises:
        UnknownDesign: lists the known ones.
    """
    if name not in DESIGNS:
        raise UnknownDesign(name, tuple(DESIGNS))
    return DESIGNS[name]


def check_subject(name: str, subject: DesignSubject) -> None:
    """Refuse what no design of this name can be made for, whatever the size.

    Raises:
        UnknownDesign: lists the known ones.
        UnsupportedRobotForDesign: saying why.
    """
    design = find_design(name)
    if len(subject.joint_box.free) == 0:
        raise UnsupportedRobotForDesign(name, subject.name, "all its joints are locked")
    robot = _robot_of(subject)
    if design.arms_only and not (isinstance(robot, Robot) and robot.kind == "arm"):
        raise UnsupportedRobotForDesign(name, subject.name, "it is no arm with a URDF")


def make_design(
    name: str,
    subject: DesignSubject,
    size: int,
    seed: int,
    options: Mapping[str, Any] | None = None,
) -> FloatArray:
    """Joint positions ``(n, dof)`` [rad or m] of a design for a robot or other function of joints.

    Args:
        name: a key of :data:`DESIGNS`.
        subject: what the examples are for; no row leaves its joint box.
        size: see the design's ``size_means``.
        seed: what a random design draws from.
        options: the design's own options.

    Raises:
        UnknownDesign: lists the known ones.
        DesignError: if an option, the size or the subject does not suit the design.
    """
    design = find_design(name)
    given = dict(options or {})
    unknown = sorted(set(given) - set(design.options))
    if unknown:
        raise DesignError(
            f"design {name} has no option {', '.join(unknown)}; it has "
            f"{', '.join((design.size_option, *design.options))}"
        )
    box = subject.joint_box
    check_subject(name, subject)
    rows = design.make(subject, size, np.random.default_rng(seed), **given)
    # Rounding must not leave the box.
    return np.clip(rows, box.lower, box.upper)
