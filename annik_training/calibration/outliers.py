"""Measured poses that can't be true: a reflection, a marker that slipped, a swapped row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from annik_core.pose import FloatArray
from annik_training.calibration.errors import TooManyOutliers
from annik_training.calibration.estimation import FittedParameters, fit_parameters
from annik_training.calibration.model import GrayBoxModel, Part
from annik_training.calibration.observations import Noise, Observations

#: How unlikely a measurement must be by chance to count as an outlier.
_IMPROBABLE = 1e-9
#: More outliers than this part of the examples, and nothing can be said of the rest.
_MOST = 0.3
#: Least standard deviation that examples are held to [m]: nobody measures better.
_LEAST_NOISE = 1e-6
_ROUNDS = 6
_EVALUATIONS = 25


def find_outliers(
    models: tuple[GrayBoxModel, GrayBoxModel],
    observations: Observations,
    noise: Noise,
    rng: np.random.Generator,
) -> NDArray[np.bool_]:
    """Which examples ``(n,)`` don't agree with the others.

    The scale that they are held to is the median of all, so that nobody has to know the noise; but
    where hardly anything is left unexplained, it is what the model can't say, or rounding.
    A fit of the geometry alone, in which a far example counts the less the farther it is, finds
    the gross ones. A fit of the joint networks too, to what is left, finds the others, and takes
    back those that only the simple model could not explain.

    Args:
        models: a stiff one and a flexible one.
        observations: of all examples.
        noise: assumed; only the ratio of its parts matters.
        rng: for the start of the networks.

    Raises:
        TooManyOutliers: if they are more than :data:`_MOST` of all.
    """
    stiff, flexible = models
    fitted = fit_parameters(stiff, observations, noise, np.zeros(stiff.size), _EVALUATIONS)
    for _ in range(_ROUNDS):
        weights = 1.0 / (1.0 + _squares(fitted) / observations.rows)
        fitted = fit_parameters(
            stiff, observations.weighted(weights), noise, fitted.parameters, _EVALUATIONS
        )
    outlying = _squares(fitted) > chi2.isf(_IMPROBABLE, observations.rows)
    start = flexible.start(rng)
    for _ in range(_ROUNDS):
        _check_number(outlying)
        fitted = fit_parameters(
            flexible, observations.weighted(1.0 * ~outlying), noise, start, 2 * _EVALUATIONS
        )
        start, before = fitted.parameters, outlying
        outlying = _squares(fitted) > chi2.isf(_IMPROBABLE, observations.rows)
        if np.array_equal(outlying, before):
            break
    _check_number(outlying)
    return np.asarray(outlying, dtype=np.bool_)


def stiff_and_flexible(robot_model: GrayBoxModel) -> tuple[GrayBoxModel, GrayBoxModel]:
    """The two models of :func:`find_outliers` for the robot of any model."""
    robot = robot_model.robot
    geometry = frozenset({Part.GEOMETRY, Part.ALIGNMENT})
    return GrayBoxModel(robot, geometry), GrayBoxModel(robot, geometry | {Part.JOINT_NETWORKS})


def _squares(fitted: FittedParameters) -> FloatArray:
    """``(n,)`` squared residuals by the fit to the others, in terms of their own median."""
    rows = fitted.observations.rows
    # What has no weight was left out as it is.
    squares: FloatArray = (fitted.left_out_residuals**2).sum(axis=1)
    least = (_LEAST_NOISE / fitted.noise.position) ** 2
    scale = max(float(np.median(squares)) / float(chi2.median(rows)), least)
    scaled: FloatArray = squares / scale
    return scaled


def _check_number(outlying: NDArray[np.bool_]) -> None:
    if outlying.mean() > _MOST:
        raise TooManyOutliers(int(outlying.sum()), len(outlying))
