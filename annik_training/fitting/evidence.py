"""Weight decay chosen from the training examples alone, by their evidence.

In the Bayesian reading of [MacKay1992]_ the weights w have a Gaussian prior of precision alpha and
the examples Gaussian noise of precision beta; the network minimises beta E_D + alpha E_W, with E_D
and E_W half the sums of squares of residuals and weights. The minimum depends on
r^2 = alpha / beta only: the weight decay r of
:class:`annik_training.fitting.variable_projection.SeparableProblem`, on all weights but those
of the linear path, whose prior is flat. With J the Jacobian of the N residuals in the p weights,
H = J^T J + r^2 I (the Gauss-Newton approximation of [Foresee1997]_), and the noise at its most
likely value, the logarithm of the evidence is, up to a constant,

    -N/2 log(2 (E_D + r^2 E_W) / N) + p log r - 1/2 log det H,

and at its maximum (MacKay's re-estimation)

    r^2 = gamma E_D / ((N - gamma) E_W),   gamma = p - r^2 tr(H^-1),

where gamma is the number of weights that the examples determine. The evidence is compared along a
path from weak to strong weight decay, each minimum being the start for the next; re-estimation
refines the best. Re-estimation alone needs very many rounds if the examples have no noise; the
path goes upwards because a strong decay may pull all weights to zero, where the gradient vanishes.

References:
    [MacKay1992] D. MacKay: Bayesian interpolation. Neural Computation 4(3), 1992.
    [Foresee1997] F. D. Foresee, M. Hagan: Gauss-Newton approximation to Bayesian learning.
    ICNN 1997.
"""

from dataclasses import dataclass

import numpy as np
import torch

from annik_core.pose import FloatArray
from annik_training.fitting.variable_projection import SeparableProblem, minimise

#: The path: weight decays a decade apart.
PATH = tuple(10.0**exponent for exponent in range(-8, 0))
#: Fraction of the evaluations that is spent on the path; the rest refines its best.
_PATH_SHARE = 0.75
#: Least sum of squares, for examples that are all alike.
_SMALLEST = 1e-300


@dataclass(frozen=True)
class Evidence:
    """Evidence of a weight decay, at the minimum for it."""

    log_evidence: float  #: up to a constant
    determined_weights: float  #: gamma
    re_estimate: float  #: the best weight decay for these gamma, E_D and E_W


def minimise_with_chosen_decay(
    problem: SeparableProblem, start: FloatArray, max_evaluations: int
) -> tuple[FloatArray, int]:
    """Hidden weights ``(p,)`` for the weight decay of most evidence, and the evaluations.

    The problem's ``ridge`` is set to that weight decay. At least one evaluation of the residual is
    spent at each point of the path; its best point is refined by re-estimation twice, if some are
    left.
    """
    share = max(1, int(_PATH_SHARE * max_evaluations) // len(PATH))
    weights, evaluations = start, 0
    stops = []
    for decay in PATH:
        problem.ridge = decay
        weights, used = minimise(problem, weights, share)
        evaluations += used
        stops.append((evidence(problem, weights), decay, weights))
    best, decay, weights = max(stops, key=lambda stop: stop[0].log_evidence)
    for remaining in (2, 1):
        # At most one step of the path: beyond it, the path has found less evidence.
        problem.ridge = float(np.clip(best.re_estimate, decay / 10.0, decay * 10.0))
        share = (max_evaluations - evaluations) // remaining
        if share > 0:
            weights, used = minimise(problem, weights, share)
            evaluations += used
            best = evidence(problem, weights)
    return weights, evaluations


def evidence(problem: SeparableProblem, weights: FloatArray) -> Evidence:
    """The evidence of the problem's weight decay, its ``ridge``.

    The hidden weights ``(p,)`` are at or near the minimum for it.
    """
    output = problem.linear_layers(weights).output
    hidden_part = problem.activations_jacobian(weights, output.T).flatten(end_dim=1)
    identity = torch.eye(problem.outputs, dtype=torch.float64)
    output_part = torch.kron(problem.activations(weights), identity)
    # By torch, which is limited to one thread; NumPy is not.
    jacobian = torch.cat([hidden_part, output_part], dim=1)
    singular = torch.linalg.svdvals(jacobian).numpy()
    count = jacobian.shape[1]
    squared_singular = np.zeros(count)
    squared_singular[: len(singular)] = singular**2

    penalty = problem.ridge**2
    squared_residual = max(problem.squared_residual(weights), _SMALLEST)
    squared_weights = max(float(np.sum(weights**2)) + float((output**2).sum()), _SMALLEST)
    observations = problem.observations
    determined = float(np.sum(squared_singular / (squared_singular + penalty)))
    free = max(observations - determined, 1.0)
    return Evidence(
        log_evidence=(
            -0.5 * observations * np.log(squared_residual + penalty * squared_weights)
            + count * np.log(problem.ridge)
            - 0.5 * float(np.sum(np.log(squared_singular + penalty)))
        ),
        determined_weights=determined,
        re_estimate=float(np.sqrt(determined * squared_residual / (free * squared_weights))),
    )
