"""Levenberg-Marquardt that gives the same bits for the same start, whatever ran before it.

Networks have directions in which the residual does not change, so the Jacobians are rank deficient
to the last digit, and rounding decides the step along these directions. SciPy's MINPACK rounds
unlike from one call to the next there (its memory is aligned now so, now otherwise), and a fit
could not be repeated. Torch aligns its memory and its factorisations are blocked, so this is also
the faster one.

One step h solves min |f + J h|^2 + mu d^2 |h|^2 by orthogonal factorisations, the columns of J
being reduced once for all damping factors mu that are tried [More1978]_; d is the greatest norm
yet of a column. All weights are damped alike: with scaled inputs and targets they are of one
order, and of the many minima this leads to one near the start. The damping factor follows the gain
ratio as in [Nielsen1999]_.

References:
    [More1978] J. J. More: The Levenberg-Marquardt algorithm: implementation and theory. Lecture
    Notes in Mathematics 630, 1978.
    [Nielsen1999] H. B. Nielsen: Damping parameter in Marquardt's method. IMM, DTU, 1999.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from annik_core.pose import FloatArray

#: The first damping factor, relative to the greatest column norm, squared.
_FIRST_DAMPING = 1e-5
#: The damping factor falls at most to a third in one step.
_LEAST_FACTOR = 1.0 / 3.0
#: Relative decrease of the sum of squares, and relative length of a step, that count as none.
TOLERANCE = 1e-12
#: Norm of a column that no weight has any effect through.
_SMALLEST_NORM = 1e-12


def levenberg_marquardt(
    residual: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    max_evaluations: int,
) -> tuple[FloatArray, int]:
    """Weights ``(p,)`` that minimise a sum of squares, and the evaluations that it took.

    Args:
        residual: weights ``(p,)`` to residuals ``(m,)``, float64; ``m`` may be less than ``p``.
        jacobian: weights to derivatives ``(m, p)``.
        start: ``(p,)``.
        max_evaluations: most evaluations of the residual, at least one.
    """
    weights = torch.tensor(start)
    residuals = torch.tensor(residual(start))
    evaluations = 1
    scale = _SMALLEST_NORM
    damping, growth = _FIRST_DAMPING, 2.0
    while evaluations < max_evaluations and float(residuals @ residuals) > 0.0:
        derivatives = torch.tensor(jacobian(weights.numpy()))
        scale = max(scale, float(torch.linalg.norm(derivatives, dim=0).max()))
        reduced, projected = _reduced(derivatives, residuals)
        accepted = False
        while not accepted and evaluations < max_evaluations:
            step = _step(reduced, projected, damping**0.5 * scale)
            candidate = weights + step
            if float(torch.linalg.norm(step)) <= TOLERANCE * float(torch.linalg.norm(weights)):
                return weights.numpy(), evaluations
            residuals_there = torch.tensor(residual(candidate.numpy()))
            evaluations += 1
            before, after = float(residuals @ residuals), float(residuals_there @ residuals_there)
            # Both sums of squares lack the same part, that which no step can change.
            expected = float(projected @ projected - torch.sum((projected + reduced @ step) ** 2))
            gain = (before - after) / expected if expected > 0.0 else -1.0
            accepted = gain > 0.0
            if accepted:
                weights, residuals = candidate, residuals_there
                damping *= max(_LEAST_FACTOR, 1.0 - (2.0 * gain - 1.0) ** 3)
                growth = 2.0
                if before - after <= TOLERANCE * before:
                    return weights.numpy(), evaluations
            else:
                damping *= growth
                growth *= 2.0
    return weights.numpy(), evaluations


def _reduced(derivatives: Tensor, residuals: Tensor) -> tuple[Tensor, Tensor]:
    """R and Q^T f of J = Q R: the same problem in at most as many rows as weights."""
    columns = derivatives.shape[1]
    both = torch.cat([derivatives, residuals[:, None]], dim=1)
    triangular = torch.linalg.qr(both, mode="r").R
    rows = min(derivatives.shape)
    return triangular[:rows, :columns], triangular[:rows, columns]


def _step(reduced: Tensor, projected: Tensor, damping: float) -> Tensor:
    """The step h of least |f + J h|^2 + |damping h|^2."""
    identity = torch.eye(reduced.shape[1], dtype=torch.float64)
    stacked = torch.cat([reduced, damping * identity])
    orthonormal, triangular = torch.linalg.qr(stacked)
    turned = orthonormal[: len(reduced)].T @ projected
    step: Tensor = -torch.linalg.solve_triangular(triangular, turned[:, None], upper=True)[:, 0]
    return step
