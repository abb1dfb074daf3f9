"""Maximum a posteriori estimate of a model's parameters, with its posterior."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space, solve_triangular

from annik_core.pose import FloatArray
from annik_training.calibration.model import ParametricModel
from annik_training.calibration.observations import Noise, Observations
from annik_training.fitting.levenberg_marquardt import levenberg_marquardt

#: Most rounds in which noise and sizes are estimated anew, and their relative change at the end.
_ROUNDS, _SETTLED = 30, 0.03
#: Rounds before the sizes are estimated, and most halvings of a step.
_FIRST_SIZES, _HALVINGS = 3, 10
#: Degrees of freedom of Student's distribution.
_HEAVINESS = 8.0
#: Least standard deviation of the noise [m], [rad]: an ideal robot's measurements have none.
LEAST_NOISE = 1e-7
#: Standard deviations of a group of parameters, in natural units.
_LEAST_SIZE, _LARGEST_SIZE = 1e-3, 30.0


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
    def cost(self) -> float:
        """Minimised sum of squares: weighted residuals and prior."""
        squares = (self.residuals**2).sum(axis=1) @ self.observations.weights
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
        weighted = self.derivatives * np.sqrt(self.observations.weights)[:, None, None]
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
        """Covariance ``(p + u, p + u)`` of the parameters; 1 where nothing was learned."""
        return np.asarray(self.root @ self.root.T, dtype=np.float64)

    @cached_property
    def leverages(self) -> FloatArray:
        """Leverages ``(n, rows, rows)``: change of the fit per change of each measurement."""
        weighted = self.derivatives * np.sqrt(self.observations.weights)[:, None, None]
        leverages: FloatArray = weighted @ self.covariance @ np.swapaxes(weighted, 1, 2)
        return leverages

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
        """Residuals ``(n, rows)`` by fits without the example, or without all of its placement.

        Of fixed points a whole placement, the points between which distances are known, is left
        out; the residuals are from the mean at each point, as far as there are two placements.
        """
        placements = self.observations.placements
        if placements is None or placements.max() == 0:
            return self.left_out_residuals
        held_out = np.zeros_like(self.residuals)
        roots = np.sqrt(self.observations.weights)
        points = self.observations.fixed_points
        assert points is not None
        for placement in range(placements.max() + 1):
            rows = np.flatnonzero((placements == placement) & (roots > 0.0))
            if not len(rows):
                continue
            # Across the weighted means at the points, which are unknowns.
            touched = 1.0 * (points[rows, None] == np.unique(points[rows])) * roots[rows, None]
            across = null_space(touched.T)
            columns = (roots[rows, None, None] * self.derivatives[rows]) @ self.root
            columns = np.einsum("nk,nrp->krp", across, columns)
            flat = columns.reshape(-1, columns.shape[2])
            residuals = across.T @ (roots[rows, None] * self.residuals[rows])
            rest = np.eye(len(flat)) - flat @ flat.T
            apart = np.linalg.solve(rest, residuals.ravel()).reshape(residuals.shape)
            held_out[rows] = across @ apart / roots[rows, None]
        return held_out

    @cached_property
    def surprise(self) -> FloatArray:
        """``(n,)`` squared leave-one-out residuals, in standard deviations of what they may be.

        Distributed as chi square, with as many degrees of freedom as rows.
        """
        weights = np.maximum(self.observations.weights, 1e-12)[:, None, None]
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
    roots = np.sqrt(observations.weights)[:, None]
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
    sizes are those of greatest evidence [MacKay1992]_: a group that the examples don't need
    vanishes. Zero weights of the observations stay zero.

    References:
        [MacKay1992] D. J. C. MacKay: Bayesian interpolation. Neural Computation 4 (3), 1992.
    """
    size = model.size + observations.frames.size
    prior, parameters = np.ones(size), np.concatenate([start, np.zeros(size - len(start))])
    if model.has_networks:
        parameters = estimate(model, observations, noise, parameters, max_evaluations).parameters
    found = Estimate(model, parameters, observations, noise, prior)
    for number in range(_ROUNDS):
        if model.has_networks:
            found = estimate(model, observations, noise, parameters, 8, prior)
        else:
            found = _improved(found)
        # First gross errors of the geometry, or they count as noise; then the noise: while it is
        # far too large, no group seems to be needed.
        if number > 0:
            noise = _noise_of(found)
        prior = _sizes(found, found.model.groups if number >= _FIRST_SIZES else ())
        squares = (residuals_of(model, found.parameters, observations, noise) ** 2).sum(axis=1)
        weights = (_HEAVINESS + observations.rows) / (_HEAVINESS + squares)
        weights = observations.weights * weights
        parameters = found.parameters
        if number > _FIRST_SIZES and _settled(found, noise, prior):
            break
        found = Estimate(model, parameters, observations.weighted(weights), noise, prior)
    return found


def _improved(found: Estimate) -> Estimate:
    """After one step of Gauss and Newton, of half the length for as long as the cost grows."""
    weights = found.observations.weights[:, None]
    gradient = np.einsum("nr,nrp->p", weights * found.residuals, found.derivatives)
    gradient += found.parameters / found.own_prior**2
    gradient[found.model.size :] += found.observations.distance_derivatives(
        found.unknowns
    ).T @ found.observations.distance_residuals(found.unknowns)
    step = -found.root @ (found.root.T @ gradient)
    for _ in range(_HALVINGS):
        moved = replace(found, parameters=found.parameters + step)
        if moved.cost <= found.cost:
            return moved
        step = 0.5 * step
    return found


def _noise_of(found: Estimate) -> Noise:
    """Noise by weighted residuals and degrees of freedom."""
    weights = found.observations.weights
    squares = weights[:, None] * found.residuals**2
    taken = np.einsum("nrr->nr", found.leverages)
    factors = [1.0, 1.0]
    for index, rows in enumerate((slice(0, 3), slice(3, 6))):
        left = np.count_nonzero(weights > 0.0) * squares[:, rows].shape[1] - taken[:, rows].sum()
        if squares[:, rows].size:
            factors[index] = float(np.sqrt(squares[:, rows].sum() / max(left, 1.0)))
    return Noise(
        max(found.noise.position * factors[0], LEAST_NOISE),
        max(found.noise.orientation * factors[1], LEAST_NOISE),
    )


def _sizes(found: Estimate, groups: Sequence[NDArray[np.int64]]) -> FloatArray:
    prior = found.own_prior.copy()
    # Student's distribution: one gross error of the geometry is no reason to doubt all.
    geometry = slice(0, len(found.model.errors))
    squares = found.parameters[geometry] ** 2
    prior[geometry] = np.sqrt(np.maximum(1.0, (_HEAVINESS + squares) / (_HEAVINESS + 1.0)))
    variances = np.einsum("ij,ij->i", found.root, found.root)
    for group in groups:
        known = len(group) - float((variances[group] / prior[group] ** 2).sum())
        square = float((found.parameters[group] ** 2).sum()) / max(known, 1e-3)
        prior[group] = min(max(math.sqrt(square), _LEAST_SIZE), _LARGEST_SIZE)
    return prior


def _settled(found: Estimate, noise: Noise, prior: FloatArray) -> bool:
    larger = np.maximum(prior, found.own_prior)
    changes = np.abs(prior - found.own_prior) / np.maximum(larger, 0.05)
    change = abs(math.log(noise.position / found.noise.position))
    return max(float(changes.max()), change) < _SETTLED
