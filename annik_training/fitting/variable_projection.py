"""Variable projection: Levenberg-Marquardt on the hidden layers, exact linear layers.

The network's last layer is linear, so for given hidden layers the best output weights are the
solution of a linear least-squares problem. Inserting that solution leaves a residual that depends
on the hidden weights only: the variable projection of [Golub1973]_. The Jacobian of
[Kaufman1975]_ drops a term that is orthogonal to the residual, so the gradient of the sum of
squares stays exact. docs/results/fit_methods.md compares it with a fit of all weights.

The network is y(x) = W phi(x) + V z(x), with the activations phi of its last hidden layer and
z = (1), or z = (x, 1) with a direct linear path. Each example gives one row of phi and z. With
Sobolev training [Czarnecki2017]_ it gives one more row for each direction t in which the
derivative of y is known: s (dphi/dx) t and s (dz/dx) t for the target s dy/dt, where s is the root
of the weight. All rows are linear in W and V.

Stacked over the examples as S, Z and targets Y, the part that Z explains is projected out of S and
Y once (so V is not penalised). With a ridge r, A = [S; r I], B = [Y; 0] and A = Q R, the residual
is E = (I - Q Q^T) B, and, for hidden weight p, Kaufman's Jacobian is
dE/dp = -(I - Q Q^T) (dA/dp) W^T, where W^T = R^-1 Q^T B are the output weights. With a weight
decay r on the hidden weights too, r p is appended to the residual.

References:
    [Golub1973] G. Golub, V. Pereyra: The differentiation of pseudo-inverses and nonlinear least
    squares problems whose variables separate. SIAM J. Numer. Anal. 10(2), 1973.
    [Kaufman1975] L. Kaufman: A variable projection method for solving separable nonlinear least
    squares problems. BIT 15, 1975.
    [Czarnecki2017] W. Czarnecki et al.: Sobolev training for neural networks. NeurIPS 2017.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import linear

from annik_core.pose import FloatArray
from annik_training.fitting.levenberg_marquardt import levenberg_marquardt
from annik_training.networks.network import HiddenLayers

#: Singular values of Z below this fraction of the largest count as zero.
_RANK_TOLERANCE = 1e-10


@dataclass(frozen=True)
class ScaledExamples:
    """Examples in the scaled units of a network; float64."""

    inputs: Tensor  #: ``(n, m)``
    targets: Tensor  #: ``(n, k)``
    #: ``(n, d, m)`` derivatives of the inputs along ``d`` directions, or None.
    directions: Tensor | None = None
    #: ``(n, d, k)`` derivatives of the targets along the same, or None.
    derivatives: Tensor | None = None

    def rows(self, indices: NDArray[np.int64]) -> "ScaledExamples":
        """Some of the examples."""
        return ScaledExamples(
            self.inputs[indices],
            self.targets[indices],
            None if self.directions is None else self.directions[indices],
            None if self.derivatives is None else self.derivatives[indices],
        )


@dataclass(frozen=True)
class LinearLayers:
    """Solution of the linear problem."""

    output: Tensor  #: ``(k, h)`` weights W of the activations
    linear_path: Tensor  #: ``(k, m)`` weights of the inputs; zero without a linear path
    bias: Tensor  #: ``(k,)``


class SeparableProblem:
    """The projected residual of a set of examples and its Jacobian.

    Args:
        hidden: the hidden layers; only their shapes are used.
        examples: the examples.
        ridge: r, weight of the output weights beside the residuals; keeps the linear problem well
            posed where activations are nearly dependent.
        linear_path: whether the inputs are connected to the outputs directly too.
        sobolev_weight: s^2, weight of the squared error of the derivatives beside that of the
            targets, if the examples have derivatives.
        decay_hidden: whether r applies to the hidden weights too.
    """

    def __init__(
        self,
        hidden: HiddenLayers,
        examples: ScaledExamples,
        ridge: float,
        *,
        linear_path: bool = False,
        sobolev_weight: float = 0.0,
        decay_hidden: bool = False,
    ) -> None:
        self.ridge = ridge
        self._hidden = hidden
        self._shapes = [parameter.shape for parameter in hidden.parameters()]
        self._decay_hidden = decay_hidden
        self._linear_path = linear_path
        self._inputs = examples.inputs
        #: ``(n, 1 + d, m)``: the inputs, then their derivatives.
        self._input_rows = examples.inputs.unsqueeze(1)
        rows, targets = _linear_rows(examples.inputs, linear_path, 1.0), examples.targets
        directions, derivatives = examples.directions, examples.derivatives
        if sobolev_weight > 0 and directions is not None and derivatives is not None:
            scale = float(np.sqrt(sobolev_weight))
            self._input_rows = torch.cat([self._input_rows, scale * directions], dim=1)
            more = _linear_rows(scale * directions.flatten(end_dim=1), linear_path, 0.0)
            rows = torch.cat([rows, more])
            targets = torch.cat([targets, scale * derivatives.flatten(end_dim=1)])
        self._linear_rows = rows
        self._targets = targets
        left, singular, _ = torch.linalg.svd(rows, full_matrices=False)
        self._explained = left[:, singular > _RANK_TOLERANCE * singular[0]]
        units = hidden.layers[-1].out_features
        assert isinstance(units, int)
        self._units = units
        self._stacked_targets = torch.cat(
            [
                self._unexplained(targets),
                torch.zeros(self._units, targets.shape[1], dtype=torch.float64),
            ]
        )

    @property
    def observations(self) -> int:
        """Number of residuals, less those that the linear path takes up."""
        rows, outputs = self._targets.shape
        return int((rows - self._explained.shape[1]) * outputs)

    @property
    def outputs(self) -> int:
        """Number of outputs of the network."""
        outputs: int = self._targets.shape[1]
        return outputs

    def residual(self, weights: FloatArray) -> FloatArray:
        """E, flattened, and r p with weight decay, at hidden weights ``(p,)``."""
        with torch.no_grad():
            projected = self._left_over(weights).reshape(-1).numpy()
        if not self._decay_hidden:
            return np.asarray(projected)
        return np.concatenate([projected, self.ridge * weights])

    def jacobian(self, weights: FloatArray) -> FloatArray:
        """Kaufman's derivative of the residual, ``(residuals, p)``."""
        with torch.no_grad():
            orthonormal, output = self._solution(weights)
            moved = self.activations_jacobian(weights, output)
            rows = len(moved)
            flat = moved.reshape(rows, -1)
            # The ridge rows of dA/dp are zero, so they enter only through the projection.
            padded = torch.cat([flat, torch.zeros(self._units, flat.shape[1], dtype=flat.dtype)])
            projected = padded - orthonormal @ (orthonormal[:rows].T @ flat)
            jacobian: FloatArray = -projected.reshape(-1, len(weights)).numpy()
        if not self._decay_hidden:
            return jacobian
        return np.concatenate([jacobian, self.ridge * np.eye(len(weights))])

    def activations_jacobian(self, weights: FloatArray, output: Tensor) -> Tensor:
        """Derivatives ``(rows, k, p)`` of S W^T with W^T ``(h, k)`` held, less what Z explains.

        Those of the values are found backwards, from the last layer to the first. Those of the
        derivatives are their derivatives along the directions.
        """
        rows = self._layer_rows(weights)
        # (n, 1 + d, k, h): derivatives of the outputs by the activations of a layer.
        by_activations = output.new_zeros(1, self._input_rows.shape[1], *output.T.shape)
        by_activations[:, 0] = output.T
        found: list[Tensor] = []
        for weight, before, after in reversed(
            list(zip(self._parts(weights)[::2], rows, rows[1:], strict=False))
        ):
            value, along = after[:, :1], after[:, 1:]
            slopes = torch.cat([1.0 - value**2, -2.0 * value * along], dim=1)
            by_bias = _product(by_activations, slopes.unsqueeze(2))
            by_weight = _product(by_bias.unsqueeze(4), before[:, :, None, None])
            found = [by_weight.flatten(start_dim=3), by_bias, *found]
            by_activations = by_bias @ weight
        stacked = _stacked(torch.cat(found, dim=3))
        return self._unexplained(stacked.flatten(start_dim=1)).reshape(stacked.shape)

    def activations(self, weights: FloatArray) -> Tensor:
        """S ``(rows, h)``, less what Z explains."""
        return self._unexplained(self._all_rows(weights))

    def linear_layers(self, weights: FloatArray) -> LinearLayers:
        """The best linear layers at these hidden weights."""
        with torch.no_grad():
            _, output = self._solution(weights)
            remaining = self._targets - self._all_rows(weights) @ output
            # With fewer examples than inputs, the pseudo-inverse gives the smallest weights.
            path = torch.linalg.pinv(self._linear_rows, rtol=_RANK_TOLERANCE) @ remaining
        inputs = self._inputs.shape[1]
        direct = path[:-1].T if self._linear_path else torch.zeros(self.outputs, inputs)
        return LinearLayers(
            output.T.contiguous(), direct.to(torch.float64).contiguous(), path[-1].contiguous()
        )

    def mean_square_error(self, weights: FloatArray) -> float:
        """Mean square error of the targets in scaled units, without derivatives and ridge."""
        with torch.no_grad():
            return float(torch.mean(self._left_over(weights)[: len(self._inputs)] ** 2))

    def squared_residual(self, weights: FloatArray) -> float:
        """Sum of squares over all rows, without the ridge."""
        with torch.no_grad():
            return float(torch.sum(self._left_over(weights)[: len(self._targets)] ** 2))

    def assign(self, weights: FloatArray) -> None:
        """Copy these weights to the hidden layers."""
        with torch.no_grad():
            for parameter, part in zip(
                self._hidden.parameters(), self._parts(weights), strict=True
            ):
                parameter.copy_(part)

    def _left_over(self, weights: FloatArray) -> Tensor:
        """E ``(rows + h, k)``."""
        orthonormal = torch.linalg.qr(self._with_ridge(weights)).Q
        explained = orthonormal @ (orthonormal.T @ self._stacked_targets)
        left_over: Tensor = self._stacked_targets - explained
        return left_over

    def _solution(self, weights: FloatArray) -> tuple[Tensor, Tensor]:
        """Q of A and the output weights W^T."""
        orthonormal, triangular = torch.linalg.qr(self._with_ridge(weights))
        output = torch.linalg.solve_triangular(
            triangular, orthonormal.T @ self._stacked_targets, upper=True
        )
        return orthonormal, output

    def _with_ridge(self, weights: FloatArray) -> Tensor:
        ridge_rows = self.ridge * torch.eye(self._units, dtype=torch.float64)
        return torch.cat([self.activations(weights), ridge_rows])

    def _unexplained(self, rows: Tensor) -> Tensor:
        unexplained: Tensor = rows - self._explained @ (self._explained.T @ rows)
        return unexplained

    def _parts(self, weights: FloatArray) -> list[Tensor]:
        """Weight ``(units, inputs)`` and bias ``(units,)`` of each hidden layer in turn."""
        sizes = [shape.numel() for shape in self._shapes]
        # Copied to torch's aligned memory: products of unaligned arrays round differently.
        parts = torch.split(torch.from_numpy(weights).clone(), sizes)
        return [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]

    def _layer_rows(self, weights: FloatArray) -> list[Tensor]:
        """Inputs and each layer's activations ``(n, 1 + d, units)``: value, then derivatives."""
        rows = [self._input_rows]
        parts = self._parts(weights)
        for weight, bias in zip(parts[::2], parts[1::2], strict=True):
            value = torch.tanh(linear(rows[-1][:, 0], weight, bias)).unsqueeze(1)
            along = (1.0 - value**2) * (rows[-1][:, 1:] @ weight.T)
            rows.append(torch.cat([value, along], dim=1))
        return rows

    def _all_rows(self, weights: FloatArray) -> Tensor:
        """S ``(rows, h)``."""
        return _stacked(self._layer_rows(weights)[-1])


def _stacked(rows: Tensor) -> Tensor:
    """Values of all examples, then their derivatives: ``(n, 1 + d, ...)`` to ``(rows, ...)``."""
    return torch.cat([rows[:, 0], rows[:, 1:].flatten(end_dim=1)])


def _product(left: Tensor, right: Tensor) -> Tensor:
    """Value and derivatives ``(n, 1 + d, ...)`` of a product of factors given likewise."""
    value = left[:, :1] * right[:, :1]
    return torch.cat([value, left[:, 1:] * right[:, :1] + left[:, :1] * right[:, 1:]], dim=1)


def _linear_rows(inputs: Tensor, linear_path: bool, constant: float) -> Tensor:
    """Rows of Z: the inputs if there is a linear path, and the constant."""
    ones = torch.full((len(inputs), 1), constant, dtype=torch.float64)
    return torch.cat([inputs, ones], dim=1) if linear_path else ones


def minimise(
    problem: SeparableProblem, start: FloatArray, max_evaluations: int
) -> tuple[FloatArray, int]:
    """Hidden weights ``(p,)`` that minimise the residual from ``start``, and the evaluations."""
    return levenberg_marquardt(problem.residual, problem.jacobian, start, max_evaluations)
