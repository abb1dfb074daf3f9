"""Options of a fit: what is allowed, and what is refused by name. ROS-free."""

from __future__ import annotations

import json

import pytest

from annik_core.errors import InvalidValue
from annik_core.robots.library import load_robot
from annik_training.defaults import defaults_of
from annik_training.designs.registry import DESIGNS
from annik_training.fitting.options import FitOptions

NAN = float("nan")


@pytest.mark.parametrize(
    "option",
    [
        {"hidden_units": ()},
        {"hidden_units": (0,)},
        {"hidden_units": (20, 4097)},
        {"hidden_units": (2,) * 9},
        {"restarts": 0},
        {"restarts": 1001},
        {"held_out_fraction": -0.01},
        {"held_out_fraction": 0.51},
        {"held_out_fraction": NAN},
        {"max_evaluations": 0},
        {"ridge": 0.0},
        {"ridge": 1.1},
        {"ridge": NAN},
        {"sobolev_weight": -1e-9},
        {"sobolev_weight": 1.1e6},
        {"sobolev_weight": float("inf")},
        {"sobolev_weight": NAN},
        {"optimiser": "adam"},
        {"optimiser": ""},
        {"bayesian_regularisation": True, "optimiser": "lbfgs"},
        {"seed": -1},
        {"seed": 2**63},
    ],
)
def test_an_option_out_of_range_is_named(option: dict[str, object]) -> None:
    with pytest.raises(InvalidValue) as caught:
        FitOptions(**option)
    assert caught.value.name == next(iter(option))


def test_what_is_allowed_is_said() -> None:
    for options, allowed in (
        ({"optimiser": "adam"}, "one of levenberg_marquardt, lbfgs"),
        ({"bayesian_regularisation": True, "optimiser": "lbfgs"}, "levenberg_marquardt"),
    ):
        with pytest.raises(InvalidValue) as caught:
            FitOptions(**options)
        assert allowed in caught.value.allowed


@pytest.mark.parametrize(
    "option",
    [
        {"hidden_units": (4096,)},
        {"hidden_units": (1,) * 8},
        {"hidden_units": (1000, 800)},
        {"restarts": 1000},
        {"held_out_fraction": 0.0},
        {"held_out_fraction": 0.5},
        {"max_evaluations": 1},
        {"ridge": 1.0},
        {"sobolev_weight": 0.0},
        {"sobolev_weight": 1e6},
        {"optimiser": "lbfgs"},
        {"optimiser": "levenberg_marquardt"},
        {"seed": 2**63 - 1},
    ],
)
def test_the_ends_of_the_ranges_are_allowed(option: dict[str, object]) -> None:
    ((name, value),) = option.items()
    assert getattr(FitOptions(**option), name) == value


def test_the_defaults_are_those_of_the_kind_of_robot() -> None:
    """The paper's way for the paper's robot."""
    gantry, arm = defaults_of(load_robot("gantry")), defaults_of(load_robot("ur5e"))
    assert (gantry.design, gantry.size, gantry.fit) == ("thirty_phase", 6, FitOptions())
    assert gantry.size == DESIGNS[gantry.design].size.default
    assert (arm.design, arm.size, arm.fit.optimiser) == ("sobol", 512, "lbfgs")


def test_every_option_is_in_the_metadata_as_json_has_it() -> None:
    options = FitOptions(hidden_units=(8, 6), linear_path=True, sobolev_weight=0.5)
    written = json.loads(json.dumps(options.to_dict(), allow_nan=False))
    expected = {**vars(options), "hidden_units": [8, 6], "slope_weight": 0.5}
    del expected["sobolev_weight"]
    assert written == expected
