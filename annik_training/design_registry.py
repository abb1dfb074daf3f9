"""The designs of experiments, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from annik_core.errors import DesignError, UnknownDesign
from annik_core.pose import FloatArray
from annik_core.robot import Robot
from annik_training import thirty_phase_design, workspace_grid_design


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


def _thirty_phase(robot: Robot, size: int, rng: np.random.Generator, **options: Any) -> FloatArray:
    return thirty_phase_design.thirty_phase_design(robot.joint_box, size, **options)


def _workspace_grid(
    robot: Robot, size: int, rng: np.random.Generator, **options: Any
) -> FloatArray:
    return workspace_grid_design.workspace_grid_design(robot, size, **options)


DESIGNS: Mapping[str, Design] = {
    design.name: design
    for design in (
        Design(
            thirty_phase_design.NAME,
            "steps",
            "steps of each sweep (j)",
            "joints swept alone and together in 30 phases: the paper's, Table 1",
            ("keep_paper_rows",),
            _thirty_phase,
        ),
        Design(
            workspace_grid_design.NAME,
            "positions_per_axis",
            "grid positions per axis",
            "a regular grid of poses: the paper's 'known method', Table 7",
            ("orientation_levels",),
            _workspace_grid,
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
