"""The design of experiments and the fit that suit each kind of robot."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from annik_core.robots.robot import Robot
from annik_core.solver.mode import SolverMode
from annik_training.fitting.options import FitOptions

#: Number of random poses of an evaluation.
DEFAULT_EVALUATION_POSES = 5000


@dataclass(frozen=True)
class Defaults:
    """How a kind of robot is trained, unless options say otherwise."""

    design: str
    size: int
    fit: FitOptions


#: An arm whose joint box is as wide as its limits.
WHOLE_ARM = "whole arm"

_ARM_FIT = FitOptions(
    hidden_units=(48, 48),
    restarts=1,
    held_out_fraction=0.0,
    max_evaluations=400,
    linear_path=True,
    sobolev_weight=1.0,
    optimiser="lbfgs",
)

DEFAULTS: Mapping[str, Defaults] = {
    # The paper's design and network for the paper's robot.
    "gantry": Defaults("thirty_phase", 6, FitOptions()),
    # A larger network; derivatives make up for few examples. A still larger one saves less time in
    # the refinement than it takes. More evaluations improve the network on the whole, but not
    # beyond a singularity, where examples are rare.
    "arm": Defaults("sobol", 512, _ARM_FIT),
    # Its guess is the first of the starts of a search, which hardly gets quicker by a better one.
    WHOLE_ARM: Defaults("sobol", 128, replace(_ARM_FIT, hidden_units=(24,), max_evaluations=100)),
}


def defaults_of(robot: Robot) -> Defaults:
    """The defaults for a robot's kind, and for how it is served."""
    if SolverMode.AUTO.of(robot) is SolverMode.WHOLE_ROBOT:
        return DEFAULTS[WHOLE_ARM]
    return DEFAULTS[robot.kind]
