"""Levenberg-Marquardt on the hidden layers alone, the output layer being solved for exactly.

The network's last layer is linear, so for given hidden layers the best output weights are the
solution of a linear least-squares problem. Putting that solution in leaves a residual that depends
on the hidden weights only: the variable projection of [Golub1973]_, with the Jacobian of
[Kaufman1975]_, which drops a term of it that is orthogonal to the residual, so that the gradient
of the sum of squares is exact. On the paper's robot it needs some 50 steps for what plain
Levenberg-Marquardt on all weights does not reach in 300; docs/training.md has the figures.

With activations Phi ``(n, h + 1)`` (the last column being 1 for the output bias), targets Y
``(n, k)`` and a ridge r, everything is written for the stacked matrices A = [Phi; r I] and
B = [Y; 0]. With A = Q R, the residual is E = (I - Q Q^T) B and, for hidden weight p, Kaufman's
Jacobian is dE/dp = -(I - Q Q^T) (dA/dp) C, where C = R^-1 Q^T B are the output weights.

References:
    [Golub1973] G. Golub, V. Pereyra: The differentiation of pseudo-inverses and nonlinear least
    squares problems whose variables separate. SIAM J. Numer. Anal. 10(2), 1973.
    [Kaufman1975] L. Kaufman: A variable projection method for solving separable nonlinear least
    squares problems. BIT 15, 1975.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor
from torch.func import functional_call, jacrev, vmap

from annik_core.pose import FloatArray
from annik_training.network import HiddenLayers


@dataclass(frozen=True)
class SeparableFit:
    """Where Levenberg-Marquardt ended.

    Attributes:
        output_weight: ``(k, h)``.
        output_bias: ``(k,)``.
        mean_square_error: over the examples and outputs, scaled units, without the ridge.
        evaluations: evaluations of the residual.
    """

    output_weight: Tensor
    output_bias: Tensor
    mean_square_error: float
    evaluations: int


class SeparableProblem:
    """The projected residual of a set of examples and its Jacobian.

    Args:
        hidden: the hidden layers; only their shapes are used.
        inputs: ``(n, inputs)`` scaled.
        targets: ``(n, k)`` scaled.
        ridge: weight of the output weights beside the residuals; keeps the linear problem well
            posed where activations are nearly dependent.
    """

    def __init__(
        self, hidden: HiddenLayers, inputs: Tensor, targets: Tensor, ridge: float
    ) -> None:
        self._hidden = hidden
        self._shapes = {name: value.shape for name, value in hidden.named_parameters()}
        self._inputs = inputs
        units = hidden.layers[-1].out_features
        assert isinstance(units, int)
        self._columns = units + 1
        self._ridge_rows = ridge * torch.eye(self._columns, dtype=torch.float64)
        padding = torch.zeros(self._columns, targets.shape[1], dtype=torch.float64)
        self._stacked_targets = torch.cat([targets, padding])

    def residual(self, weights: FloatArray) -> FloatArray:
        """E, flattened, at these hidden weights ``(p,)``."""
        with torch.no_grad():
            orthonormal = torch.linalg.qr(self._stacked(weights)).Q
            projected = orthonormal @ (orthonormal.T @ self._stacked_targets)
            residual: FloatArray = (self._stacked_targets - projected).reshape(-1).numpy()
        return residual

    def jacobian(self, weights: FloatArray) -> FloatArray:
        """Kaufman's dE/dp ``(size of E, p)``, with exact derivatives of the activations."""
        named = self._named(weights)
        derivatives = vmap(jacrev(self._activations), in_dims=(None, 0))(named, self._inputs)
        with torch.no_grad():
            flat = torch.cat([derivatives[name].flatten(start_dim=2) for name in named], dim=2)
            orthonormal, output = self._solution(weights)
            examples = len(self._inputs)
            moved = torch.einsum("nhp,hk->nkp", flat, output[:-1]).reshape(examples, -1)
            # The ridge rows of dA/dp are zero, so they enter only through the projection.
            stacked = torch.cat(
                [moved, torch.zeros(self._columns, moved.shape[1], dtype=torch.float64)]
            )
            projected = stacked - orthonormal @ (orthonormal[:examples].T @ moved)
            outputs = output.shape[1]
            jacobian: FloatArray = (
                -projected.reshape(len(stacked), outputs, -1).reshape(-1, flat.shape[2]).numpy()
            )
        return jacobian

    def output_layer(self, weights: FloatArray) -> tuple[Tensor, Tensor]:
        """The best output weight ``(k, h)`` and bias ``(k,)`` at these hidden weights."""
        with torch.no_grad():
            _, output = self._solution(weights)
        return output[:-1].T.contiguous(), output[-1].contiguous()

    def mean_square_error(self, weights: FloatArray) -> float:
        """Mean square error over examples and outputs, scaled units, without the ridge."""
        examples = len(self._inputs)
        outputs = self._stacked_targets.shape[1]
        return float(np.mean(self.residual(weights)[: examples * outputs] ** 2))

    def assign(self, weights: FloatArray) -> None:
        """Put these weights into the hidden layers."""
        with torch.no_grad():
            named = self._named(weights)
            for name, parameter in self._hidden.named_parameters():
                parameter.copy_(named[name])

    @property
    def residuals(self) -> int:
        """How many numbers :meth:`residual` returns."""
        return self._stacked_targets.numel()

    def _solution(self, weights: FloatArray) -> tuple[Tensor, Tensor]:
        """Q of A and the output weights C, with the bias as last row."""
        orthonormal, triangular = torch.linalg.qr(self._stacked(weights))
        output = torch.linalg.solve_triangular(
            triangular, orthonormal.T @ self._stacked_targets, upper=True
        )
        return orthonormal, output

    def _named(self, weights: FloatArray) -> dict[str, Tensor]:
        sizes = [shape.numel() for shape in self._shapes.values()]
        parts = torch.split(torch.from_numpy(weights), sizes)
        return {
            name: part.reshape(shape)
            for (name, shape), part in zip(self._shapes.items(), parts, strict=True)
        }

    def _activations(self, named: Mapping[str, Tensor], inputs: Tensor) -> Tensor:
        activations: Tensor = functional_call(self._hidden, dict(named), (inputs,))
        return activations

    def _stacked(self, weights: FloatArray) -> Tensor:
        activations = self._activations(self._named(weights), self._inputs)
        ones = torch.ones(len(activations), 1, dtype=torch.float64)
        return torch.cat([torch.cat([activations, ones], dim=1), self._ridge_rows])


def fit_separable(
    hidden: HiddenLayers,
    inputs: Tensor,
    targets: Tensor,
    ridge: float,
    max_evaluations: int,
) -> SeparableFit:
    """Fit hidden layers, in place, and the output layer that belongs to them.

    Args:
        hidden: the hidden layers; their weights are the start.
        inputs: ``(n, inputs)`` scaled, float64.
        targets: ``(n, k)`` scaled, float64.
        ridge: see :class:`SeparableProblem`.
        max_evaluations: most evaluations of the residual, which bounds the time.
    """
    problem = SeparableProblem(hidden, inputs, targets, ridge)
    start = torch.cat([value.detach().reshape(-1) for value in hidden.parameters()]).numpy()
    # MINPACK wants at least as many residuals as weights; SciPy's own method does not.
    enough = problem.residuals >= start.size
    solution = least_squares(
        problem.residual,
        start,
        problem.jacobian,
        method="lm" if enough else "trf",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-15,
        max_nfev=max_evaluations,
    )
    problem.assign(solution.x)
    weight, bias = problem.output_layer(solution.x)
    return SeparableFit(weight, bias, problem.mean_square_error(solution.x), int(solution.nfev))
