"""The paper's sets of examples: section 2 for its functions F, section 3 for its robot."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.registry import make_design
from benchmarks.systems.function_system import paper_functions

#: Section 2: q from 0 to 90 degrees in steps of 5.
SECTION_2_STEPS = 18
#: Section 2: the levels of f1..f6 of the known method, "step 3.3" in [0, 10], as Table 2 has them.
SECTION_2_LEVELS = (0.0, 3.3, 6.6, 10.0)


class DesignOfSet(NamedTuple):
    """Design, size and options that give one of the sets of Table 7."""

    design: str
    size: int
    options: Mapping[str, Any]


ROBOT_SETS: Mapping[str, Mapping[str, DesignOfSet]] = {
    "thirty_phase": {
        "set1": DesignOfSet("thirty_phase", 3, {}),
        "set2": DesignOfSet("thirty_phase", 6, {}),
        "set3": DesignOfSet("thirty_phase", 15, {}),
    },
    "known": {
        "set1": DesignOfSet("workspace_grid", 3, {"orientation_levels": 1}),
        "set2": DesignOfSet("workspace_grid", 4, {"orientation_levels": 1}),
        "set3": DesignOfSet("workspace_grid", 4, {"orientation_levels": 2}),
    },
}


def paper_robot() -> Robot:
    """The robot of section 3, with the constants of eq. (13)-(14)."""
    return load_robot("gantry")


def robot_set(method: str, name: str) -> FloatArray:
    """Joint positions ``(n, 6)`` [rad] of a set of Table 7."""
    chosen = ROBOT_SETS[method][name]
    return make_design(paper_robot(), chosen.design, chosen.size, 0, chosen.options)


def function_set(method: str) -> FloatArray:
    """Joint positions ``(n, 6)`` [rad] of a set of section 2."""
    if method == "thirty_phase":
        return make_design(paper_functions(), "thirty_phase", SECTION_2_STEPS, 0)
    return _known_method_of_section_2()


def _known_method_of_section_2() -> FloatArray:
    """375 points of the grid of f1..f6, taken back to joint positions by the inverses of f1..f6.

    The paper prints only the ends of this list: a star around 3.3, and one around 10 at the end.
    The points with at most two different levels, without the one where all are zero, are 375 and
    contain both.
    """
    grid = itertools.product(SECTION_2_LEVELS, repeat=6)
    values = np.array([point for point in grid if len(set(point)) <= 2 and any(point)])
    greatest = paper_functions().joint_box.upper
    fraction = values / 10.0
    return np.column_stack(
        [
            np.arcsin(fraction[:, 0]),
            np.arccos(1.0 - fraction[:, 1]),
            greatest[2] * np.sqrt(fraction[:, 2]),
            greatest[3:] * fraction[:, 3:],
        ]
    )


def counts() -> dict[str, dict[str, int]]:
    """How many examples each set has, here and with the rows that the paper keeps."""
    robot = paper_robot()
    paper_rows = {
        name: len(
            make_design(
                robot,
                "thirty_phase",
                ROBOT_SETS["thirty_phase"][name].size,
                0,
                {"keep_paper_rows": True},
            )
        )
        for name in ("set1", "set2", "set3")
    }
    by_method = {
        method: {
            **{name: len(robot_set(method, name)) for name in ROBOT_SETS[method]},
            "section2": len(function_set(method)),
        }
        for method in ROBOT_SETS
    }
    return {**by_method, "paper_rows": paper_rows}
