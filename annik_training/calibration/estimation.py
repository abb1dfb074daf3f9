"""The parameters of a gray-box model that fit measured poses best, and how well they are known."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from annik_core.pose import FloatArray
from annik_training.calibration.model import GrayBoxModel
from annik_training.calibration.observations import Noise, Observations
from annik_training.fitting.levenberg_marquardt import levenberg_marquardt


@dataclass(frozen=True, eq=False)
class FittedParameters:
    """Parameters of greatest posterior density, and the linear model around them.

    The posterior is that of Gaussian noise and a Gaussian prior of unit variance on every
    parameter in natural units; around its maximum it is Gaussian (Laplace's approximation).

    Attributes:
        model: whose parameters they are.
        parameters: ``(p,)`` in natural units.
        observations: what they were fitted to.
        noise: by which the residuals were weighted.
    """

    model: GrayBoxModel
    parameters: FloatArray
    observations: Observations
    noise: Noise

    @property
    def cost(self) -> float:
        """Sum of squares that was minimised: weighted residuals and prior."""
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
        """``(n, rows, p)`` of the residuals by the parameters."""
        evaluated = self.model.evaluate(self.parameters, self.observations.joint_positions)
        return self.observations.derivatives(evaluated.columns, self.noise)

    @cached_property
    def root(self) -> FloatArray:
        """``(p, p)`` which turns independent standard normal numbers into draws around the fit.

        By the derivatives themselves, not by their squares: if the noise is small, these span more
        digits than a number has.
        """
        weighted = self.derivatives * np.sqrt(self.observations.weights)[:, None, None]
        size = self.model.size
        stacked = np.concatenate([weighted.reshape(-1, size), np.eye(size)])
        triangular = np.linalg.qr(stacked, mode="r")
        return np.asarray(solve_triangular(triangular, np.eye(size)), dtype=np.float64)

    @cached_property
    def covariance(self) -> FloatArray:
        """``(p, p)`` of the parameters; 1 where nothing was learned."""
        return np.asarray(self.root @ self.root.T, dtype=np.float64)

    @cached_property
    def leverages(self) -> FloatArray:
        """``(n, rows, rows)`` how much of a change of each measurement the fit takes on."""
        weighted = self.derivatives * np.sqrt(self.observations.weights)[:, None, None]
        leverages: FloatArray = weighted @ self.covariance @ np.swapaxes(weighted, 1, 2)
        return leverages

    @property
    def degrees_of_freedom(self) -> float:
        """Measured numbers less those that the parameters take up; at least one."""
        taken = float(np.einsum("nrr->", self.leverages))
        return max(1.0, self.residuals.size - taken)

    @cached_property
    def left_out_residuals(self) -> FloatArray:
        """``(n, rows)`` residuals of each example by the fit to all others.

        Exact for a model that is linear in its parameters, which this nearly is around the fit.
        """
        rest = np.eye(self.observations.rows) - self.leverages
        left_out = np.linalg.solve(rest, self.residuals[..., None])[..., 0]
        return np.asarray(left_out, dtype=np.float64)


def fit_parameters(
    model: GrayBoxModel,
    observations: Observations,
    noise: Noise,
    start: FloatArray,
    max_evaluations: int = 100,
) -> FittedParameters:
    """Fit by Levenberg-Marquardt.

    Args:
        model: what to fit.
        observations: to what.
        noise: of the observations.
        start: ``(p,)`` where to begin.
        max_evaluations: most evaluations of the residuals.
    """
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
    return FittedParameters(model, parameters, observations, noise)
