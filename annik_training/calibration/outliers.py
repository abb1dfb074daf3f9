"""Outliers among measurements: a reflection, a marker that slipped, a swapped row."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from annik_core.pose import FloatArray
from annik_training.calibration.errors import UnexplainedMeasurements
from annik_training.calibration.estimation import Estimate, tuned
from annik_training.calibration.model import ParametricModel
from annik_training.calibration.observations import Noise, Observations

#: Standard deviations from which a measurement is an outlier. Play and friction move an arm by
#: tens of those that its other measurements have.
_SLIPPED = 20.0
#: Largest fraction of outliers; with more, the others can't be trusted either.
_MOST = 0.3
#: Least standard deviation that is assumed [m]; no instrument measures better.
_LEAST_NOISE = 1e-6
_ROUNDS = 4


def find_outliers(
    model: ParametricModel, observations: Observations, noise: Noise
) -> tuple[NDArray[np.bool_], Estimate]:
    """Examples ``(n,)`` that don't agree with the others, by a model that explains the most.

    Also the fit without them.

    Residuals are compared with what the fit without the example expects, and with their own
    median. ``noise`` is where the estimate of the noise begins.

    Raises:
        UnexplainedMeasurements: if they are more than :data:`_MOST` of all.
    """
    outlying = np.zeros(len(observations), dtype=np.bool_)
    for _ in range(_ROUNDS):
        weighted = observations.weighted(np.where(outlying, 0.0, 1.0))
        fitted = tuned(model, weighted, noise, np.zeros(model.size))
        before = outlying
        outlying = _squares(fitted) > _SLIPPED**2
        if outlying.mean() > _MOST:
            raise UnexplainedMeasurements(
                f"{int(outlying.sum())} of {len(outlying)} measured poses are far from those of "
                "any model of the robot"
            )
        if np.array_equal(outlying, before):
            break
    return np.asarray(outlying, dtype=np.bool_), fitted


def _squares(fitted: Estimate) -> FloatArray:
    """Squares ``(n,)`` of what is surprising, scaled by their median."""
    rows = fitted.observations.rows
    least = (_LEAST_NOISE / fitted.noise.position) ** 2
    scale = max(float(np.median(fitted.surprise)) / float(chdtri(rows, 0.5)), least)
    scaled: FloatArray = fitted.surprise / scale
    return scaled
