"""Fits around an estimate, where its model is linear, by sums over the rows alone.

With other noise, sizes of the parameters, weights or rows a fit costs no evaluation of the model.

References:
    [MacKay1992] D. J. C. MacKay: Bayesian interpolation. Neural Computation 4 (3), 1992.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri

from annik_core.pose import FloatArray
from annik_training.calibration.observations import Observations

#: Degrees of freedom of Student's distribution, of errors of the geometry.
_HEAVINESS = 4.0
#: Standard deviations of a group of parameters, in natural units.
LEAST_SIZE, LARGEST_SIZE = 1e-3, 30.0


class Equations(NamedTuple):
    """Sums over rows of the products of all columns: the derivatives, and last the residuals."""

    positions: FloatArray  #: ``(p + 1, p + 1)`` of the positions
    orientations: FloatArray  #: the same of the orientations
    distances: FloatArray  #: the same of known distances between fixed points
    counts: FloatArray  #: ``(2,)`` how many coordinates were measured, of either kind

    @classmethod
    def of(
        cls,
        columns: FloatArray,
        distances: FloatArray,
        observations: Observations,
    ) -> "Equations":
        """Of columns ``(n, rows, p + 1)``, and ``(distances, p + 1)``."""
        weighted = columns * np.sqrt(observations.information)[:, None, None]
        positions, orientations = (
            part.T @ part
            for part in (
                weighted[:, rows].reshape(-1, columns.shape[2])
                for rows in (slice(0, 3), slice(3, 6))
            )
        )
        rows = np.array([3, columns.shape[1] - 3], dtype=np.float64)
        counts = np.count_nonzero(observations.weights) / observations.redundancy * rows
        return cls(positions, orientations, distances.T @ distances, counts)

    def without(self, other: "Equations") -> "Equations":
        """Those of the rows that are not in ``other``; the distances stay."""
        return Equations(
            self.positions - other.positions,
            self.orientations - other.orientations,
            self.distances,
            self.counts - other.counts,
        )


@dataclass(frozen=True, eq=False)
class LinearFit:
    """The parameters of greatest posterior density near others, by equations around those.

    Attributes:
        equations: whose residuals are in some standard deviations.
        noise: ``(2,)`` of positions and orientations, in these standard deviations.
        around: ``(p,)`` parameters.
        prior: ``(p,)`` their standard deviations.
    """

    equations: Equations
    noise: FloatArray
    around: FloatArray
    prior: FloatArray

    @cached_property
    def covariance(self) -> FloatArray:
        """``(p, p)`` of the parameters."""
        # In place: copies of large matrices take longer than the factorisation.
        scaled = self.prior[:, None] * self._sums[:-1, :-1]
        scaled *= self.prior
        scaled[np.diag_indices_from(scaled)] += 1.0
        factor = cholesky(scaled.T, overwrite_a=True, check_finite=False)
        upper = dpotri(factor, overwrite_c=True)[0]
        covariance: FloatArray = upper + upper.T
        covariance[np.diag_indices_from(covariance)] *= 0.5
        covariance *= self.prior[:, None]
        covariance *= self.prior
        return covariance

    @cached_property
    def step(self) -> FloatArray:
        """``(p,)`` from the parameters around which it is."""
        gradient = self._sums[:-1, -1] + self.around / self.prior**2
        return np.asarray(-self.covariance @ gradient, dtype=np.float64)

    def expected(self, columns: FloatArray) -> FloatArray:
        """Root mean squares ``(n, rows)`` of the residuals with columns ``(n, rows, p + 1)``.

        By noise and posterior, the same for the three coordinates of a kind.
        """
        derivatives = columns[..., :-1]
        squares = ((derivatives @ self.covariance) * derivatives).sum(axis=2)
        kinds = squares.reshape(len(columns), -1, 3).mean(axis=2)
        kinds += self.noise[: kinds.shape[1]] ** 2
        return np.asarray(np.sqrt(np.repeat(kinds, 3, axis=1)), dtype=np.float64)

    def noise_found(self, least: FloatArray) -> FloatArray:
        """Noise ``(2,)`` by the residuals and their degrees of freedom, at least ``(2,)``."""
        whole, noise = np.append(self.step, 1.0), self.noise.copy()
        for kind, sums in enumerate((self.equations.positions, self.equations.orientations)):
            taken = float((self.covariance * sums[:-1, :-1]).sum()) / noise[kind] ** 2
            left = max(float(self.equations.counts[kind]) - taken, 1.0)
            if self.equations.counts[kind]:
                noise[kind] = math.sqrt(max(float(whole @ sums @ whole), 0.0) / left)
        return np.maximum(noise, least)

    def sizes_found(self, tailed: int, groups: Sequence[NDArray[np.int64]]) -> FloatArray:
        """Prior ``(p,)`` with the size of greatest evidence of each group [MacKay1992]_.

        The first ``tailed`` parameters have Student's distribution: one gross error is no reason
        to doubt all.
        """
        prior, found = self.prior.copy(), self.around + self.step
        squares = found[:tailed] ** 2
        prior[:tailed] = np.sqrt(np.maximum(1.0, (_HEAVINESS + squares) / (_HEAVINESS + 1.0)))
        variances = np.diag(self.covariance)
        for group in groups:
            known = len(group) - float((variances[group] / self.prior[group] ** 2).sum())
            size = math.sqrt(float((found[group] ** 2).sum()) / max(known, 1e-3))
            prior[group] = min(max(size, LEAST_SIZE), LARGEST_SIZE)
        return prior

    def distance_from(self, other: "LinearFit") -> float:
        """Largest relative difference of noise and sizes."""
        larger = np.maximum(np.maximum(self.prior, other.prior), 0.05)
        change = float((np.abs(self.prior - other.prior) / larger).max())
        return max(change, float(np.abs(np.log(self.noise / other.noise)).max()))

    @cached_property
    def _sums(self) -> FloatArray:
        positions, orientations, distances, _ = self.equations
        position, orientation = self.noise.tolist()
        sums: FloatArray = positions / position**2 + orientations / orientation**2 + distances
        return sums
