"""Outliers among measured poses: a reflection, a marker that slipped, a swapped row."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_training.calibration.errors import UnexplainedMeasurements
from annik_training.calibration.estimation import Estimate, estimate
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise, Observations

#: Probability by chance below which a measurement is an outlier.
_IMPROBABLE = 1e-9
#: Largest fraction of outliers; with more, the others can't be trusted either.
_MOST = 0.3
#: Least standard deviation that is assumed [m]; no instrument measures better.
_LEAST_NOISE = 1e-6
_ROUNDS = 6
_EVALUATIONS = 25


def find_outliers(
    robot: Robot, observations: Observations, noise: Noise, rng: np.random.Generator
) -> NDArray[np.bool_]:
    """Examples ``(n,)`` that don't agree with the others.

    Residuals are compared with their own median, so that only the ratio of position to orientation
    of the assumed noise matters. A robust fit of a stiff model, the geometry alone, finds the
    gross outliers. Fits of one with joint networks to the remaining examples find the others, and
    accept those that only the stiff model could not explain.

    Raises:
        UnexplainedMeasurements: if they are more than :data:`_MOST` of all.
    """
    geometry = frozenset({Part.GEOMETRY, Part.ALIGNMENT})
    stiff = ParametricModel(robot, geometry)
    flexible = ParametricModel(robot, geometry | {Part.JOINT_NETWORKS})
    fitted = estimate(stiff, observations, noise, np.zeros(stiff.size), _EVALUATIONS)
    for _ in range(_ROUNDS):
        weights = 1.0 / (1.0 + _squares(fitted) / observations.rows)
        fitted = estimate(
            stiff, observations.weighted(weights), noise, fitted.parameters, _EVALUATIONS
        )
    outlying = _squares(fitted) > chi2.isf(_IMPROBABLE, observations.rows)
    start = flexible.start(rng)
    for _ in range(_ROUNDS):
        _check_number(outlying)
        fitted = estimate(
            flexible, observations.weighted(1.0 * ~outlying), noise, start, 2 * _EVALUATIONS
        )
        start, before = fitted.parameters, outlying
        outlying = _squares(fitted) > chi2.isf(_IMPROBABLE, observations.rows)
        if np.array_equal(outlying, before):
            break
    _check_number(outlying)
    return np.asarray(outlying, dtype=np.bool_)


def _squares(fitted: Estimate) -> FloatArray:
    """Squared leave-one-out residuals ``(n,)``, scaled by their median."""
    rows = fitted.observations.rows
    # Examples of zero weight are left out of the fit, so their residuals count as they are.
    squares: FloatArray = (fitted.left_out_residuals**2).sum(axis=1)
    least = (_LEAST_NOISE / fitted.noise.position) ** 2
    scale = max(float(np.median(squares)) / float(chi2.median(rows)), least)
    scaled: FloatArray = squares / scale
    return scaled


def _check_number(outlying: NDArray[np.bool_]) -> None:
    if outlying.mean() > _MOST:
        raise UnexplainedMeasurements(
            f"{int(outlying.sum())} of {len(outlying)} measured poses are far from those of any "
            "model of the robot"
        )
