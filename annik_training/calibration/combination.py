"""The mean of several fits of the same rows that best predicts what each of them did not see.

Few rows don't tell for sure which parts a model needs, nor how much each row tells. So fits with
other parts, and such that trust the rows less, are averaged. Their weights are those with which
the mean predicts rows best that were left out of the fits: stacked regression [Breiman1996]_. A
mean of the parameters is one of the poses, since the models are nearly linear around their fits.

References:
    [Breiman1996] L. Breiman: Stacked regressions. Machine Learning 24, 1996.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.optimize import nnls
from scipy.special import chdtri

from annik_core.pose import FloatArray
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.linear_fit import LEAST_SIZE
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise

#: A squared residual counts at most so many medians: a few large ones decide nothing.
_LARGEST_RATIO = 25.0
#: A fit of less weight is left out.
_LEAST_WEIGHT = 0.05
#: A part has to make the squares of the residuals smaller by this part of them.
_WORTH = 0.02
#: How much more than the residuals the sum of the weights, which is one, counts.
_SUM = 1e4


@dataclass(frozen=True)
class Candidate:
    """How well a fit with some of the parts predicts rows that it did not see."""

    parts: frozenset[Part]
    redundancy: float  #: so many rows told as much as one
    parameters: int
    #: Mean square of the held-out residuals, relative to most of those of the fit whose positions
    #: are best.
    score: float
    standard_error: float  #: of its difference from the least score
    weight: float  #: of the fit in the mean


@dataclass(frozen=True, eq=False)
class MeanEstimate(Estimate):
    """The mean of some estimates of the same rows.

    Its prior has the variance of a choice among theirs.
    """

    members: tuple[Estimate, ...] = ()
    shares: FloatArray = field(default_factory=lambda: np.zeros(0))  #: their weights; sum 1

    @classmethod
    def of(cls, members: Sequence[Estimate], shares: FloatArray) -> "MeanEstimate":
        """The mean with weights ``(members,)`` whose sum is 1."""
        first = members[0]
        parts = frozenset().union(*(one.model.parts for one in members))
        model = ParametricModel(first.model.robot, parts, first.model.gravity)
        size = model.size + first.observations.frames.size
        parameters, variances = np.zeros((2, size))
        noise, information = np.zeros(2), np.zeros(len(first.observations))
        for share, one in zip(shares.tolist(), members, strict=True):
            places = np.append(one.model.indices_in(model), np.arange(model.size, size))
            parameters[places] += share * one.parameters
            variances[places] += share * one.own_prior**2
            found = one.residual_noise
            noise += share * np.array([found.position, found.orientation]) ** 2
            information += share * one.observations.information
        redundancy = 1.0 / float(shares @ [1.0 / one.observations.redundancy for one in members])
        observations = replace(
            first.observations, weights=redundancy * information, redundancy=redundancy
        )
        return cls(
            model,
            parameters,
            observations,
            Noise(*np.sqrt(noise).tolist()),
            np.maximum(np.sqrt(variances), LEAST_SIZE),
            tuple(members),
            shares,
        )

    @cached_property
    def held_out_residuals(self) -> FloatArray:
        """The mean of theirs."""
        residuals = np.zeros_like(self.residuals)
        for share, one in zip(self.shares, self.members, strict=True):
            residuals += share * one.held_out_residuals * (one.unit / self.unit)
        return residuals

    @cached_property
    def _without_placements(self) -> tuple[FloatArray, FloatArray]:
        residuals, ratios = (np.zeros_like(self.residuals) for _ in range(2))
        for share, one in zip(self.shares, self.members, strict=True):
            residual, ratio = one._without_placements
            residuals += share * residual * (one.unit / self.unit)
            ratios += share * ratio
        return residuals, ratios


def combined(fits: Sequence[Estimate]) -> tuple[Estimate, tuple[Candidate, ...]]:
    """The mean of fits, the simplest first; where one has networks, the one that is chosen.

    The weights of networks have no mean.
    """
    residuals = np.array([fit.held_out_residuals * fit.unit for fit in fits])
    sizes = [_typical(one, fits[0].observations.least_noise) for one in residuals]
    residuals /= min(sizes, key=lambda one: float(one[0]))
    squares = (residuals**2).mean(axis=2)
    largest = _LARGEST_RATIO * np.median(squares, axis=1, keepdims=True)
    counted = np.minimum(squares, largest)
    scores = counted.mean(axis=1)
    best = int(np.argmin(scores))
    deviations = [
        _deviation(fit, own) for fit, own in zip(fits, counted - counted[best], strict=True)
    ]
    if any(fit.model.has_networks for fit in fits):
        shares = np.eye(len(fits))[_chosen(scores, deviations)]
    else:
        # Rows that the best fit predicts badly count less for all.
        part = np.minimum(1.0, largest[best] / np.maximum(squares[best], 1e-300))
        shares = _shares(fits, residuals * np.sqrt(part)[:, np.newaxis])
    candidates = tuple(
        Candidate(fit.model.parts, fit.observations.redundancy, fit.model.size, *numbers)
        for fit, *numbers in zip(fits, scores.tolist(), deviations, shares.tolist(), strict=True)
    )
    used = np.flatnonzero(shares)
    if len(used) == 1 and fits[used[0]].observations.redundancy == 1.0:
        return fits[int(used[0])], candidates
    return MeanEstimate.of([fits[index] for index in used.tolist()], shares[used]), candidates


def _typical(residuals: FloatArray, least: float) -> FloatArray:
    """Standard deviations ``(rows,)`` of most residuals ``(n, rows)``, of positions and angles."""
    kinds = residuals.reshape(len(residuals), -1, 3)
    medians = np.median((kinds**2).sum(axis=2), axis=0) / float(chdtri(3, 0.5))
    return np.repeat(np.maximum(np.sqrt(medians), least), 3)


def _deviation(fit: Estimate, differences: FloatArray) -> float:
    """Standard error of the mean of ``(n,)``; rows of a fold may not be independent."""
    folds = fit.observations.folds
    parts = np.array([differences[folds == fold].mean() for fold in np.unique(folds)])
    return float(parts.std(ddof=1)) / math.sqrt(len(parts))


def _chosen(scores: FloatArray, deviations: Sequence[float]) -> int:
    """The simplest whose score is no more than a standard error from the best."""
    return int(np.flatnonzero(scores - deviations <= scores.min())[0])


def _shares(fits: Sequence[Estimate], residuals: FloatArray) -> FloatArray:
    """Weights ``(fits,)`` of the mean with the fewest parts that predicts the rows well.

    By held-out residuals ``(fits, n, rows)``.
    """
    columns = residuals.reshape(len(fits), -1).T
    everything = _least_squares(columns)
    enough = (1.0 + _WORTH) * float(((columns @ everything) ** 2).sum())
    for model in sorted((fit.model for fit in fits), key=lambda one: one.size):
        inside = [fit.model.parts <= model.parts for fit in fits]
        shares = np.zeros(len(fits))
        shares[inside] = _least_squares(columns[:, inside])
        if float(((columns @ shares) ** 2).sum()) <= enough:
            return shares
    return everything


def _least_squares(columns: FloatArray) -> FloatArray:
    """Weights of columns, none negative or small, and of sum 1, whose weighted mean is least."""
    used = np.ones(columns.shape[1], dtype=np.bool_)
    whole = max(_SUM * float(np.linalg.norm(columns, axis=0).max()), 1e-300)
    for _ in range(2):
        shares = np.zeros(len(used))
        shares[used], _ = nnls(
            np.vstack([columns[:, used], np.full(used.sum(), whole)]),
            np.append(np.zeros(len(columns)), whole),
        )
        used = shares >= _LEAST_WEIGHT * shares.sum()
    shares[~used] = 0.0
    return np.asarray(shares / shares.sum())
