"""Options of the fit of a network."""

from dataclasses import asdict, dataclass
from operator import mul
from typing import Any

from annik_core.errors import InvalidValue
from annik_core.settings import setting, settings_of

_MAX_SEED = 2**63 - 1
#: With them a model file is a little smaller than the largest that is read.
_MAX_WEIGHTS = 800_000


@dataclass(frozen=True)
class FitOptions:
    """Options of the fit of a network; the defaults are the paper's.

    Raises:
        InvalidValue: naming the option and what is allowed.
    """

    hidden_units: tuple[int, ...] = setting(
        (20,), "Sizes of the hidden layers, such as 20,20.", flag="--hidden"
    )
    restarts: int = setting(
        6, "Number of fits from random initial weights.", within=(1, 1000), flag="--restarts"
    )
    held_out_fraction: float = setting(
        0.15,
        "Fraction of the examples that only choose the best restart. With 0 all are fitted, and "
        "the smallest error on them decides.",
        within=(0.0, 0.5),
        flag="--held-out",
    )
    max_evaluations: int = setting(
        50,
        "Most evaluations of the residual in one restart.",
        within=(1, 100_000),
        flag="--max-evaluations",
    )
    linear_path: bool = setting(
        False, "Connect the inputs to the outputs directly too.", flag="--linear-path"
    )
    sobolev_weight: float = setting(
        0.0,
        "Weight of the derivatives beside the outputs, both scaled. 0 is off; 1 suits examples "
        "without noise.",
        within=(0.0, 1e6),
        flag="--sobolev",
    )
    bayesian_regularisation: bool = setting(
        False,
        "Choose the weight decay by the evidence of the examples: for few or noisy ones.",
        flag="--bayesian",
    )
    optimiser: str = setting(
        "levenberg_marquardt",
        "Method: levenberg_marquardt is exact, for small networks; lbfgs is for thousands of "
        "weights.",
        choices=("levenberg_marquardt", "lbfgs"),
        flag="--optimiser",
    )
    ridge: float = setting(
        1e-7,
        "Weight of the output weights beside the residuals; without effect if the evidence "
        "chooses it, and with lbfgs.",
        greater_than=0.0,
        within=(None, 1.0),
    )
    seed: int = setting(
        0, "Seed of the held-out examples and the initial weights.", within=(0, _MAX_SEED)
    )

    def __post_init__(self) -> None:
        """Refuse options out of range."""
        units = self.hidden_units
        if not (0 < len(units) <= 8 and all(1 <= number <= 4096 for number in units)):
            raise InvalidValue("hidden_units", units, "1 to 8 layers of 1 to 4096 units")
        if sum(map(mul, units, units[1:])) > _MAX_WEIGHTS:
            allowed = f"layers with at most {_MAX_WEIGHTS} weights between them"
            raise InvalidValue("hidden_units", units, allowed)
        for entry in settings_of(type(self)):
            if entry.name != "hidden_units":
                entry.checked(getattr(self, entry.name))
        if self.bayesian_regularisation and self.optimiser != "levenberg_marquardt":
            allowed = "with the optimiser levenberg_marquardt only"
            raise InvalidValue("bayesian_regularisation", True, allowed)

    def to_dict(self) -> dict[str, Any]:
        """The options for a model's metadata, with the keys of the file format."""
        options = {**asdict(self), "hidden_units": list(self.hidden_units)}
        options["slope_weight"] = options.pop("sobolev_weight")
        return options
