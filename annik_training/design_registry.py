"""The designs of experiments, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.errors import DesignError, UnknownDesign
from annik_core.pose import FloatArray
from annik_core.robot import Robot
from annik_training import (
    sampling_designs,
    thirty_phase_design,
    thirty_phase_plus_design,
    workspace_grid_design,
)


@dataclass(frozen=True)
class Design:
    """A way to choose joint positions for the examples.

    Attributes:
        name: what it is called on the command line.
        size_option: what the size is called on the command line.
        size_means: what the size counts.
        description: one line.
        options: names of what can be set besides the size.
        make: ``(robot, size, rng, **options) -> (n, dof)`` joint positions inside the robot's
            joint box; the same for the same seed.
    """

    name: str
    size_option: str
    size_means: str
    description: str
    options: tuple[str, ...]
    make: Callable[..., FloatArray]


def _in_box(design: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    """A design that needs the joint box and no randomness."""

    def make(robot: Robot, size: int, rng: np.random.Generator, **options: Any) -> FloatArray:
        return design(robot.joint_box, size, **options)

    return make


def _drawn_in_box(design: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    """A design that draws from the joint box."""

    def make(robot: Robot, size: int, rng: np.random.Generator, **options: Any) -> FloatArray:
        return design(robot.joint_box, size, rng, **options)

    return make


def _in_workspace(design: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    """A design of poses, which needs the whole robot."""

    def make(robot: Robot, size: int, rng: np.random.Generator, **options: Any) -> FloatArray:
        return design(robot, size, **options)

    return make


_STEPS = ("steps", "steps of each sweep (j)")
_EXAMPLES = ("examples", "number of examples")

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
            "a regular grid of poses: the paper's 'known method', Table 7",
            ("orientation_levels",),
            _in_workspace(workspace_grid_design.workspace_grid_design),
        ),
        Design(
            "latin_hypercube",
            *_EXAMPLES,
            "one example in each slice of every joint, otherwise at random",
            (),
            _drawn_in_box(sampling_designs.latin_hypercube_design),
        ),
        Design(
            "sobol",
            *_EXAMPLES,
            "a scrambled Sobol sequence: evenly spread, and can be continued",
            (),
            _drawn_in_box(sampling_designs.sobol_design),
        ),
        Design(
            "random",
            *_EXAMPLES,
            "independent and uniform",
            (),
            _drawn_in_box(sampling_designs.random_design),
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


def make_design(
    name: str, robot: Robot, size: int, seed: int, options: Mapping[str, Any] | None = None
) -> FloatArray:
    """Joint positions ``(n, dof)`` [rad or m] of a design for a robot.

    Args:
        name: a key of :data:`DESIGNS`.
        robot: the robot; no row leaves its joint box.
        size: see the design's ``size_means``.
        seed: what a random design draws from.
        options: the design's own options.

    Raises:
        UnknownDesign: lists the known ones.
        DesignError: if an option or the size does not suit the design.
    """
    design = find_design(name)
    given = dict(options or {})
    unknown = sorted(set(given) - set(design.options))
    if unknown:
        raise DesignError(
            f"design {name} has no option {', '.join(unknown)}; it has "
            f"{', '.join(design.options) or 'none'}"
        )
    rows = design.make(robot, size, np.random.default_rng(seed), **given)
    # Rounding at the upper end of a sweep must not leave the box.
    return np.clip(rows, robot.joint_box.lower, robot.joint_box.upper)
