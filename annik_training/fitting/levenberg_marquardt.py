"""Levenberg-Marquardt whose result is the same, bit for bit, for the same start.

The Jacobians of networks are rank deficient, and rounding decides the step along the directions
without effect. SciPy's MINPACK rounds differently from call to call, with the alignment of its
memory, so a fit could not be repeated; torch aligns its memory, and is faster.

One step h solves min |f + J h|^2 + mu d^2 |h|^2 by orthogonal factorisations; J is reduced once
for all damping factors mu that are tried [More1978]_, and d is the greatest column norm so far.
All weights are damped alike, since with scaled inputs and targets they are of the same order. The
damping factor follows the gain ratio as in [Nielsen1999]_.

References:
    [More1978] J. J. More: The Levenberg-Marquardt algorithm: implementation and theory. Lecture
    Notes in Mathematics 630, 1978.
    [Nielsen1999] H. B. Nielsen: Damping parameter in Marquardt's method. IMM, DTU, 1999.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits
from torch import Tensor

from annik_core.pose import FloatArray

#: First damping factor mu.
_FIRST_DAMPING = 1e-5
#: The damping factor falls at most to a third in one step.
_LEAST_FACTOR = 1.0 / 3.0
#: Converged at this relative decrease of the sum of squares, or relative length of a step.
TOLERANCE = 1e-12
#: Least column norm d.
_SMALLEST_NORM = 1e-12


def levenberg_marquardt(
    residual: Callable[[FloatArray], FloatArray],
    jacobian: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    max_evaluations: int,
) -> tuple[FloatArray, int]:
    """Weights ``(p,)`` that minimise a sum of squares, and the number of evaluations.

    Args:
        residual: weights ``(p,)`` to residuals ``(m,)``, float64; ``m`` may be less than ``p``.
        jacobian: weights to derivatives ``(m, p)``.
        start: ``(p,)`` initial weights.
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
            # Both sums of squares omit the part that no step can change.
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


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch and linear algebra to one thread.

    Results depend on the number of threads, and for small matrices more are slower.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        torch.set_num_threads(threads)
