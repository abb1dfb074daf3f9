"""How to fit a network."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from annik_core.errors import AnnikError


class TrainingError(AnnikError):
    """A network could not be trained."""


class InvalidTrainingOption(TrainingError):
    """A training option is out of range."""

    def __init__(self, option: str, value: object, allowed: str) -> None:
        self.option = option
        self.value = value
        self.allowed = allowed
        super().__init__(f"{option} is {value!r}; allowed: {allowed}")


OPTIMISERS = ("levenberg_marquardt", "lbfgs")


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        hidden_units: sizes of the hidden layers; the paper's network has one of 20.
        restarts: how many random starts to fit; the best on the held-out examples wins.
        held_out_fraction: part of the examples that only choose the winner. With 0 all examples
            are fitted, and the start with the smallest error on them wins.
        max_evaluations: most evaluations of the residual per start.
        ridge: see :class:`annik_training.fitting.variable_projection.SeparableProblem`; with
            ``bayesian_regularisation`` it has no part, nor with ``lbfgs``.
        linear_path: let the inputs reach the outputs directly too: y = A x + b + W phi(x), with
            A and b from least squares together with W, see
            :mod:`annik_training.fitting.variable_projection`.
        slope_weight: Sobolev training: weight of the squared error of each slope dy/dq_j beside
            that of y, both scaled. Needs the Jacobian of the forward kinematics; 0 is off.
        bayesian_regularisation: choose the weight decay by the evidence of the training examples,
            see :mod:`annik_training.fitting.evidence`.
        optimiser: ``levenberg_marquardt``, see
            :mod:`annik_training.fitting.variable_projection`, the more exact one, for small
            networks; or ``lbfgs``, see :mod:`annik_training.fitting.lbfgs`, for thousands
            of weights.
        seed: everything random is drawn from it.

    Raises:
        InvalidTrainingOption: naming the option and what is allowed.
    """

    hidden_units: tuple[int, ...] = (20,)
    restarts: int = 6
    held_out_fraction: float = 0.15
    max_evaluations: int = 50
    ridge: float = 1e-7
    linear_path: bool = False
    slope_weight: float = 0.0
    bayesian_regularisation: bool = False
    optimiser: str = "levenberg_marquardt"
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse options that make no sense."""
        for option, valid, allowed in (
            (
                "hidden_units",
                0 < len(self.hidden_units) <= 8 and all(1 <= n <= 4096 for n in self.hidden_units),
                "1 to 8 layers of 1 to 4096 units",
            ),
            ("restarts", 1 <= self.restarts <= 1000, "1 to 1000"),
            ("held_out_fraction", 0 <= self.held_out_fraction <= 0.5, "0 to 0.5"),
            ("max_evaluations", 1 <= self.max_evaluations <= 100_000, "1 to 100000"),
            ("ridge", 0 < self.ridge <= 1, "more than 0, at most 1"),
            ("slope_weight", 0 <= self.slope_weight <= 1e6, "0 to 1000000"),
            ("optimiser", self.optimiser in OPTIMISERS, " or ".join(OPTIMISERS)),
            (
                "bayesian_regularisation",
                not self.bayesian_regularisation or self.optimiser == "levenberg_marquardt",
                "with the optimiser levenberg_marquardt only",
            ),
            ("seed", 0 <= self.seed < 2**63, "0 to 2^63 - 1"),
        ):
            if not valid:
                raise InvalidTrainingOption(option, getattr(self, option), allowed)

    def as_plain_data(self) -> dict[str, Any]:
        """The options for a model's metadata."""
        return {**asdict(self), "hidden_units": list(self.hidden_units)}


#: How to fit an arm, unless told otherwise: it takes a larger network than the paper's robot, and
#: by the slopes of its model few examples say much more. More evaluations make the network's
#: answer better on the whole and worse beyond a fold, where examples are rare: more targets are
#: then not solved at all.
ARM_OPTIONS = FitOptions(
    hidden_units=(64, 64, 64),
    restarts=1,
    held_out_fraction=0.0,
    max_evaluations=400,
    linear_path=True,
    slope_weight=1.0,
    optimiser="lbfgs",
)


def default_options(robot_kind: str) -> FitOptions:
    """How to fit a kind of robot: the paper's way for the paper's robot."""
    return ARM_OPTIONS if robot_kind == "arm" else FitOptions()
