"""The ways to fit that are compared, by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

#: Name to what it sets of :class:`annik_training.fitting.options.FitOptions`.
TRAINING_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "plain": {},
    "linear_path": {"linear_path": True},
    "sobolev": {"sobolev_weight": 1.0},
    "bayesian": {"bayesian_regularisation": True},
    "sobolev_bayesian": {"sobolev_weight": 1.0, "bayesian_regularisation": True},
}

#: Name to what it does, in a line.
TRAINING_MEANINGS: Mapping[str, str] = {
    "plain": "the paper's network, fitted to the examples",
    "linear_path": "the inputs reach the outputs directly too; the hidden units add the rest",
    "sobolev": "the derivatives are fitted too, by the Jacobian of the robot's model",
    "bayesian": "the weight decay is chosen by the evidence of the examples",
    "sobolev_bayesian": "the derivatives are fitted too, and the weight decay is chosen",
}
