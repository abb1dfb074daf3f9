"""Maximum a posteriori estimate of a model's parameters, with its posterior."""

import math
from dataclasses import astuple, dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from annik_core.pose import FloatArray
from annik_training.calibration.linear_fit import LEAST_SIZE, Equations, LinearFit
from annik_training.calibration.model import ParametricModel
from annik_training.calibration.observations import Noise, Observations
from annik_training.fitting.levenberg_marquardt import levenberg_marquardt

#: Most linearisations, most turns of noise and sizes in one, and their relative change at the end.
_LINEARISATIONS, _TURNS, _SETTLED = 12, 8, 0.03
#: Linearisations before the sizes are estimated, and most halvings of a step.
_FIRST_SIZES, _HALVINGS = 3, 10


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters of greatest posterior density, and the linear model around them.

    Gaussian noise, and a Gaussian prior on every parameter in natural units. The posterior is
    taken as Gaussian around its maximum (Laplace's approximation).
    """

    model: ParametricModel
    #: ``(p + u,)`` in natural units, then the unknowns of the frames [m, rad].
    parameters: FloatArray
    observations: Observations
    noise: Noise  #: standard deviations that the residuals were weighted by
    #: ``(p + u,)`` standard deviations of the prior; None: all 1.
    prior: FloatArray | None = None

    @property
    def model_parameters(self) -> FloatArray:
        """``(p,)`` those of the model alone."""
        return self.parameters[: self.model.size]

    @property
    def unknowns(self) -> FloatArray:
        """``(u,)`` motions of the frames and fixed points."""
        return self.parameters[self.model.size :]

    @property
    def unit(self) -> FloatArray:
        """``(rows,)`` standard deviation of the noise [m], [rad]."""
        kinds = [self.noise.position, self.noise.orientation]
        return np.repeat(kinds, 3)[: self.observations.rows]

    @property
    def cost(self) -> float:
        """Minimised sum of squares: weighted residuals and prior."""
        squares = (self.residuals**2).sum(axis=1) @ self.observations.information
        distances = self.observations.distance_residuals(self.unknowns)
        scaled = self.parameters / self.own_prior
        return float(squares + distances @ distances + scaled @ scaled)

    @cached_property
    def residuals(self) -> FloatArray:
        """``(n, rows)`` model minus measured, in standard deviations of the noise."""
        return residuals_of(self.model, self.parameters, self.observations, self.noise)

    @cached_property
    def derivatives(self) -> FloatArray:
        """``(n, rows, p + u)`` derivatives of the residuals by the parameters."""
        return derivatives_of(self.model, self.parameters, self.observations, self.noise)

    @cached_property
    def root(self) -> FloatArray:
        """Square root ``(p + u, p + u)`` of the covariance: times standard normals, a draw.

        By a QR factorisation of the derivatives: their normal equations lose digits if the noise
        is small.
        """
        weighted = self.derivatives * np.sqrt(self.observations.information)[:, None, None]
        size = len(self.parameters)
        distances = np.zeros((len(self.observations.distances), size))
        distances[:, self.model.size :] = self.observations.distance_derivatives(self.unknowns)
        # In standard deviations of the prior, so that no column is out of scale.
        rows = np.concatenate([weighted.reshape(-1, size), distances]) * self.own_prior
        triangular = np.linalg.qr(np.concatenate([rows, np.eye(size)]), mode="r")
        root = self.own_prior[:, None] * solve_triangular(triangular, np.eye(size))
        return np.asarray(root, dtype=np.float64)

    @property
    def own_prior(self) -> FloatArray:
        """``(p + u,)`` standard deviations of the prior."""
        return np.ones(len(self.parameters)) if self.prior is None else self.prior

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance ``(p + u, p + u)``; that of the prior where nothing was learned."""
        return np.asarray(self.root @ self.root.T, dtype=np.float64)

    @cached_property
    def leverages(self) -> FloatArray:
        """Leverages ``(n, rows, rows)``: change of the fit per change of each measurement."""
        weighted = self.derivatives * np.sqrt(self.observations.information)[:, None, None]
        drawn = (weighted.reshape(-1, weighted.shape[2]) @ self.root).reshape(weighted.shape)
        leverages: FloatArray = drawn @ np.swapaxes(drawn, 1, 2)
        return leverages

    @cached_property
    def residual_noise(self) -> Noise:
        """Noise by the residuals and their degrees of freedom, whatever the rows count."""
        found = astuple(self.noise_by(self.observations.weights))
        return Noise(*(max(noise, self.observations.least_noise) for noise in found))

    def noise_by(self, weights: FloatArray) -> Noise:
        """The same with other weights ``(n,)`` of the rows; zero where all residuals are."""
        weighted = self.residuals**2 * weights[:, None]
        taken = np.einsum("nrr->r", self.leverages)
        found = [self.noise.position, self.noise.orientation]
        for kind, rows in enumerate((slice(0, 3), slice(3, 6))):
            part = weighted[:, rows]
            if part.size:
                counted = np.count_nonzero(weights) * part.shape[1]
                left = max(counted - float(taken[rows].sum()), 1.0)
                found[kind] *= math.sqrt(float(part.sum()) / left)
        return Noise(*found)

    @property
    def least_noise(self) -> FloatArray:
        """``(2,)`` least noise of the observations, in standard deviations of this one."""
        noise = np.array([self.noise.position, self.noise.orientation])
        return np.asarray(self.observations.least_noise / noise)

    @property
    def degrees_of_freedom(self) -> float:
        """Number of residuals less those that the parameters take up; at least one."""
        taken = float(np.einsum("nrr->", self.leverages))
        return max(1.0, self.residuals.size - taken)

    @cached_property
    def left_out_residuals(self) -> FloatArray:
        """Leave-one-out residuals ``(n, rows)``.

        Exact for a model that is linear in its parameters, as this one nearly is around the fit.
        """
        rest = np.eye(self.observations.rows) - self.leverages
        left_out = np.linalg.solve(rest, self.residuals[..., None])[..., 0]
        return np.asarray(left_out, dtype=np.float64)

    @cached_property
    def held_out_residuals(self) -> FloatArray:
        """Residuals ``(n, rows)`` by fits without the fold of the row, see :class:`Observations`.

        The fits have a noise and sizes of their own.
        """
        if self.observations.leaves_placements_out:
            return self._without_placements[0]
        columns, _ = self.columns(self.used)
        return self._held_out(self.observations.folds, columns)[0]

    @cached_property
    def unseen_residuals(self) -> FloatArray | None:
        """Residuals ``(n, rows)`` by fits without the whole placement of the row.

        Such a fit knows much less than the whole one: each residual is divided by how much more
        its fit expects of it, by noise and posterior. None without two placements.
        """
        placements = self.observations.placements
        if placements is None or placements.max() == 0:
            return None
        return np.divide(*self._without_placements)

    @cached_property
    def _without_placements(self) -> tuple[FloatArray, FloatArray]:
        """As ``_held_out``; from the mean at each fixed point, which is unknown then."""
        placements, points = self.observations.placements, self.observations.fixed_points
        assert placements is not None and points is not None
        columns, _ = self.columns(self.used)
        weights = self.observations.weights
        for point in np.unique(points):
            rows = points == point
            columns[rows] -= np.average(columns[rows], axis=0, weights=weights[rows])
        return self._held_out(placements, columns)

    def _held_out(
        self, folds: NDArray[np.int64], predicted: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals ``(n, rows)`` by fits without a fold, and their expected ratio to the whole's.

        ``predicted`` are the columns ``(n, rows, p + 1)`` of what is predicted.
        """
        used = self.used
        columns, distances = self.columns(used)
        groups, observations = self.used_groups(used), self.observations
        whole = Equations.of(columns, distances, observations)
        start = np.ones(2), self.parameters[used], self.own_prior[used]
        by_all = LinearFit(whole, *start).expected(predicted)
        held_out, ratios = predicted[..., -1].copy(), np.ones_like(by_all)
        for fold in np.unique(folds):
            rows = folds == fold
            part = Equations.of(columns[rows], distances, observations.where(rows))
            equations = whole.without(part)
            fit = LinearFit(equations, *start)
            for _ in range(_TURNS):
                before = fit
                prior = before.sizes_found(self.tailed, groups)
                fit = LinearFit(
                    equations, before.noise_found(self.least_noise), before.around, prior
                )
                if fit.distance_from(before) < _SETTLED:
                    break
            held_out[rows] += predicted[rows, :, :-1] @ fit.step
            ratios[rows] = fit.expected(predicted[rows]) / by_all[rows]
        return held_out, ratios

    def used_groups(self, used: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """The groups of the model's parameters among those that are used."""
        return [np.searchsorted(used, group) for group in self.model.groups if group[0] in used]

    @property
    def tailed(self) -> int:
        """Number of parameters, the first, whose prior is Student's distribution.

        Those of the geometry. Without a measured length all of them are Gaussian: an arm without
        any length would explain fixed points best, and gross errors of all lengths cost too little
        to prevent it.
        """
        return len(self.model.errors) if self.observations.has_length else 0

    @property
    def used(self) -> NDArray[np.int64]:
        """Indices of the parameters whose group has not vanished."""
        return np.flatnonzero(self.own_prior > LEAST_SIZE)

    def columns(self, used: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Derivatives by these parameters and residuals ``(n, rows, p + 1)``; of distances too."""
        columns = np.concatenate([self.derivatives[..., used], self.residuals[..., None]], axis=2)
        distances = np.zeros((len(self.observations.distances), len(self.parameters)))
        distances[:, self.model.size :] = self.observations.distance_derivatives(self.unknowns)
        residuals = self.observations.distance_residuals(self.unknowns)
        return columns, np.concatenate([distances[:, used], residuals[:, None]], axis=1)

    @cached_property
    def surprise(self) -> FloatArray:
        """``(n,)`` squared leave-one-out residuals, in standard deviations of what they may be.

        Distributed as chi square, with as many degrees of freedom as rows.
        """
        weights = np.maximum(self.observations.information, 1e-12)[:, None, None]
        rest = np.eye(self.observations.rows) - self.leverages
        expected = rest + self.leverages / weights
        scaled = np.linalg.solve(expected, self.residuals[..., None])[..., 0]
        return np.asarray((scaled * self.left_out_residuals).sum(axis=1), dtype=np.float64)


def residuals_of(
    model: ParametricModel, parameters: FloatArray, observations: Observations, noise: Noise
) -> FloatArray:
    """Residuals ``(n, rows)`` at parameters ``(p + u,)``."""
    where = model.positions_and_rotations(parameters[: model.size], observations.joint_positions)
    return observations.residuals(*where, noise, parameters[model.size :])


def derivatives_of(
    model: ParametricModel, parameters: FloatArray, observations: Observations, noise: Noise
) -> FloatArray:
    """Their derivatives ``(n, rows, p + u)``."""
    evaluated = model.evaluate(parameters[: model.size], observations.joint_positions)
    return observations.derivatives(evaluated, noise, parameters[model.size :])


def estimate(
    model: ParametricModel,
    observations: Observations,
    noise: Noise,
    start: FloatArray,
    max_evaluations: int = 100,
    prior: FloatArray | None = None,
) -> Estimate:
    """Estimate by Levenberg-Marquardt from initial parameters ``(p,)`` or ``(p + u,)``."""
    roots = np.sqrt(observations.information)[:, None]
    size = model.size + observations.frames.size
    start = np.concatenate([start, np.zeros(size - len(start))])
    scale = np.ones(size) if prior is None else prior

    def residual(scaled: FloatArray) -> FloatArray:
        parameters = scale * scaled
        rows = roots * residuals_of(model, parameters, observations, noise)
        distances = observations.distance_residuals(parameters[model.size :])
        return np.concatenate([rows.ravel(), distances, scaled])

    def jacobian(scaled: FloatArray) -> FloatArray:
        parameters = scale * scaled
        rows = roots[..., None] * derivatives_of(model, parameters, observations, noise)
        distances = np.zeros((len(observations.distances), size))
        distances[:, model.size :] = observations.distance_derivatives(parameters[model.size :])
        stacked = np.concatenate([rows.reshape(-1, size), distances]) * scale
        return np.concatenate([stacked, np.eye(size)])

    scaled, _ = levenberg_marquardt(residual, jacobian, start / scale, max_evaluations)
    return Estimate(model, scale * scaled, observations, noise, prior)


def tuned(
    model: ParametricModel,
    observations: Observations,
    noise: Noise,
    start: FloatArray,
    max_evaluations: int = 8,
) -> Estimate:
    """Estimate the parameters, the noise, and the size of each group of parameters, in turns.

    The noise is that of Student's distribution, so that a few large residuals weigh little. The
    sizes are those of greatest evidence: a group that the examples don't need vanishes. Zero
    weights of the observations stay zero.
    """
    size = model.size + observations.frames.size
    parameters = np.concatenate([start, np.zeros(size - len(start))])
    if model.has_networks:
        parameters = estimate(model, observations, noise, parameters, max_evaluations).parameters
    found = Estimate(model, parameters, observations, noise, np.ones(size))
    for number in range(_LINEARISATIONS):
        if model.has_networks:
            now = found.observations, found.noise, found.parameters
            found = estimate(model, *now, 8, found.prior)
        found, settled = _in_turns(found, observations.weights, number)
        if settled:
            break
    return found


def _in_turns(found: Estimate, own: FloatArray, number: int) -> tuple[Estimate, bool]:
    """Parameters, noise and sizes by the model that is linear around an estimate.

    ``own`` are the weights of the observations themselves. Also, whether little has changed.
    """
    used = found.used
    columns, distances = found.columns(used)
    groups = found.used_groups(used)
    observations = found.observations
    equations = Equations.of(columns, distances, observations)
    fit = LinearFit(equations, np.ones(2), found.parameters[used], found.own_prior[used])
    settled = False
    for turn in range(_TURNS if number > _FIRST_SIZES else 1):
        before = fit
        # First gross errors of the geometry, or they count as noise; then the noise: while it is
        # far too large, no group seems to be needed.
        noise = before.noise_found(found.least_noise) if number > 0 else before.noise
        prior = before.sizes_found(found.tailed, groups if number >= _FIRST_SIZES else ())
        left = columns @ np.append(before.step, 1.0)
        squares = ((left / np.repeat(noise, 3)[: left.shape[1]]) ** 2).sum(axis=1)
        degrees = observations.noise_degrees
        weights = own * (degrees + left.shape[1]) / (degrees + squares)
        observations = observations.weighted(weights)
        equations = Equations.of(columns, distances, observations)
        fit = LinearFit(equations, noise, before.around, prior)
        if fit.distance_from(before) < _SETTLED:
            settled = turn == 0 and number > _FIRST_SIZES
            break
    return _moved(replace(found, observations=observations), fit, used), settled


def _moved(found: Estimate, fit: LinearFit, used: NDArray[np.int64]) -> Estimate:
    """After the step of a fit, of half the length for as long as the cost grows."""
    position, orientation = fit.noise.tolist()
    noise = Noise(found.noise.position * position, found.noise.orientation * orientation)
    parameters, step = np.zeros((2, len(found.parameters)))
    prior = np.full(len(parameters), LEAST_SIZE)
    parameters[used], step[used], prior[used] = fit.around, fit.step, fit.prior
    here = Estimate(found.model, parameters, found.observations, noise, prior)
    for _ in range(_HALVINGS):
        moved = replace(here, parameters=parameters + step)
        if moved.cost <= here.cost:
            return moved
        step = 0.5 * step
    return here
