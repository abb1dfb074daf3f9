"""How heavy the tails of the noise are: of arms, and of instruments, that differs.

Measurements that are far from a fit count less in it if the tails are heavy. If they are not, that
costs accuracy.
"""

import numpy as np
from scipy.special import gammaln

from annik_core.pose import FloatArray
from annik_training.calibration.observations import NOISE_DEGREES

#: Degrees of freedom of Student's distribution that are compared; the last is nearly Gauss's.
_DEGREES = np.array([NOISE_DEGREES, 8.0, 16.0, 1000.0])
_ROUNDS = 50
#: Least scale of the squares, of the largest one.
_LEAST_SCALE = 1e-12


def noise_degrees(squares: FloatArray, dimensions: int, redundancy: float = 1.0) -> float:
    """Degrees of freedom of the noise, by squares ``(n,)`` of residuals with so many components.

    Their scale does not matter. The mean of the inverse over the posterior: few residuals don't
    tell for sure. So many, ``redundancy``, tell as much as one.
    """
    if not squares.any():
        return NOISE_DEGREES
    squares = squares / squares.max()
    likelihoods = np.array(
        [_log_likelihood(squares, dimensions, degrees) for degrees in _DEGREES.tolist()]
    )
    probabilities = np.exp((likelihoods - likelihoods.max()) / redundancy)
    probabilities /= probabilities.sum()
    return float(1.0 / (probabilities @ (1.0 / _DEGREES)))


def _log_likelihood(squares: FloatArray, dimensions: int, degrees: float) -> float:
    """Greatest over the scale, which is found by expectation maximisation; up to a constant."""
    scale = max(float(np.median(squares)) / dimensions, _LEAST_SCALE)
    for _ in range(_ROUNDS):
        weights = (degrees + dimensions) / (degrees + squares / scale)
        scale = max(float((weights * squares).mean()) / dimensions, _LEAST_SCALE)
    half = 0.5 * (degrees + dimensions)
    each = gammaln(half) - gammaln(0.5 * degrees) - 0.5 * dimensions * np.log(degrees * scale)
    rows = np.log1p(squares / (degrees * scale))
    return float(len(squares) * each - half * rows.sum())
