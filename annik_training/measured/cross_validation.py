"""Does a model predict examples that it was really not fitted to?

The closed form for leaving one example out takes the networks for linear. A flexible one finds
ways to agree with an example that this does not see, so a close decision in its favour is checked
by fits, from other starts, to parts of the examples.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_training.measured.fit_parameters import fit_parameters
from annik_training.measured.gray_box_model import GrayBoxModel
from annik_training.measured.observations import Noise, Observations

_FOLDS = 5


def predicts_better(
    flexible: GrayBoxModel,
    simple: GrayBoxModel,
    observations: Observations,
    noise: Noise,
    rng: np.random.Generator,
) -> bool:
    """Whether the flexible model's held-out errors are less, by more than a standard error.

    Args:
        flexible: the model in question.
        simple: what would be used instead.
        observations: all examples, outliers left out.
        noise: of the observations.
        rng: divides the examples, and starts the networks.
    """
    fold = rng.permutation(len(observations)) % _FOLDS
    gains = np.subtract(
        *(_held_out_squares(model, observations, noise, fold, rng) for model in (simple, flexible))
    )
    return bool(gains.mean() > gains.std(ddof=1) / math.sqrt(len(gains)))


def _held_out_squares(
    model: GrayBoxModel,
    observations: Observations,
    noise: Noise,
    fold: NDArray[np.int64],
    rng: np.random.Generator,
) -> FloatArray:
    """``(n,)`` squared residuals of each example by the fit without its fold."""
    squares = np.empty(len(observations))
    for number in range(_FOLDS):
        held_out = observations.where(fold == number)
        rest = observations.where(fold != number)
        fitted = fit_parameters(model, rest, noise, model.start(rng))
        where = model.positions_and_rotations(fitted.parameters, held_out.joint_positions)
        squares[fold == number] = (held_out.residuals(*where, noise) ** 2).sum(axis=1)
    return squares
