"""Maximum a posteriori estimate of a model's parameters, with its posterior."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from annik_core.pose import FloatArray
from annik_training.calibration.model import ParametricModel
from annik_training.calibration.observations import Noise, Observations
from annik_training.fitting.levenberg_marquardt import levenberg_marquardt


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters of greatest posterior density, and the linear model around them.

    Gaussian noise, and a Gaussian prior of unit variance on every parameter in natural units. The
    posterior is taken as Gaussian around its maximum (Laplace's approximation).
    """

    model: ParametricModel
    parameters: FloatArray  #: ``(p,)`` in natural units
    observations: Observations
    noise: Noise  #: standard deviations that the residuals were weighted by

    @property
    def cost(self) -> float:
        """Minimised sum of squares: weighted residuals and prior."""
        squares = (self.residuals**2).sum(axis=1) @ self.observations.weights
        return float(squares + self.parameters @ self.parameters)

    @cached_property
    def residuals(self) -> FloatArray:
        """``(n, rows)`` model minus measured, in standard deviations of the noise."""
        where = self.model.positions_and_rotations(
            self.parameters, self.observations.joint_positions
        )
        return self.observations.residuals(*where, self.noise)

    @cached_property
    def derivatives(self) -> FloatArray:
        """``(n, rows, p)`` derivatives of the residuals by the parameters."""
        evaluated = self.model.evaluate(self.parameters, self.observations.joint_positions)
        return self.observations.derivatives(evaluated.columns, self.noise)

    @cached_property
    def root(self) -> FloatArray:
        """Square root ``(p, p)`` of the covariance: times standard normal numbers, a draw.

        By a QR factorisation of the derivatives: their normal equations lose digits if the noise
        is small.
        """
        weighted = self.derivatives * np.sqrt(self.observations.weights)[:, None, None]
        size = self.model.size
        stacked = np.concatenate([weighted.reshape(-1, size), np.eye(size)])
        triangular = np.linalg.qr(stacked, mode="r")
        return np.asarray(solve_triangular(triangular, np.eye(size)), dtype=np.float64)

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance ``(p, p)`` of the parameters; 1 where nothing was learned."""
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


def estimate(
    model: ParametricModel,
    observations: Observations,
    noise: Noise,
    start: FloatArray,
    max_evaluations: int = 100,
) -> Estimate:
    """Estimate the parameters by Levenberg-Marquardt from initial ones ``(p,)``."""
    roots = np.sqrt(observations.weights)[:, None]

    def residual(parameters: FloatArray) -> FloatArray:
        where = model.positions_and_rotations(parameters, observations.joint_positions)
        rows = roots * observations.residuals(*where, noise)
        return np.concatenate([rows.ravel(), parameters])

    def jacobian(parameters: FloatArray) -> FloatArray:
        evaluated = model.evaluate(parameters, observations.joint_positions)
        rows = roots[..., None] * observations.derivatives(evaluated.columns, noise)
        return np.concatenate([rows.reshape(-1, model.size), np.eye(model.size)])

    parameters, _ = levenberg_marquardt(residual, jacobian, start, max_evaluations)
    return Estimate(model, parameters, observations, noise)
