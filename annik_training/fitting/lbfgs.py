"""L-BFGS on all weights, for networks whose Jacobian is too large to factorise.

Minimises the mean square error of the targets and, with Sobolev training, of the derivatives
beside it; see :mod:`annik_training.fitting.variable_projection`. The derivatives of a network of
tanh layers are carried forward with its activations, so one evaluation with d directions costs as
much as 1 + d evaluations without.
"""

import inspect
import math

import torch
from torch import Tensor, nn

from annik_training.fitting.variable_projection import ScaledExamples
from annik_training.networks.network import ScaledNetwork

#: Pairs of steps and gradients that approximate the curvature.
_HISTORY = 50


def minimise_all_weights(
    network: ScaledNetwork, examples: ScaledExamples, sobolev_weight: float, max_evaluations: int
) -> int:
    """Fit all weights of a network in place; returns the number of evaluations.

    Each evaluates error and gradient. If they end within a line search, the best weights so far
    are used.
    """
    optimiser = _Lbfgs(
        network.parameters(),
        max_iter=max_evaluations,
        max_eval=max_evaluations,
        tolerance_grad=1e-12,
        tolerance_change=1e-14,
        history_size=_HISTORY,
        line_search_fn="strong_wolfe",
    )
    evaluations = 0
    least = math.inf
    best = [weights.detach().clone() for weights in network.parameters()]

    def error() -> Tensor:
        nonlocal evaluations, least, best
        if evaluations == max_evaluations:
            # The optimiser itself counts only after a line search.
            raise _EvaluationsUsedUp
        evaluations += 1
        network.zero_grad()
        value = _error(network, examples, sobolev_weight)
        value.backward()  # type: ignore[no-untyped-call]
        if value.item() < least:
            least = value.item()
            best = [weights.detach().clone() for weights in network.parameters()]
        return value

    try:
        optimiser.step(error)  # type: ignore[no-untyped-call]
        lost = not all(bool(torch.isfinite(weights).all()) for weights in network.parameters())
    except _EvaluationsUsedUp:
        lost = True
    if lost:
        with torch.no_grad():
            for weights, found in zip(network.parameters(), best, strict=True):
                weights.copy_(found)
    return evaluations


class _Lbfgs(torch.optim.LBFGS):
    # As it is decorated, it loads torch's compiler, which takes longer than many a fit.
    add_param_group = inspect.unwrap(torch.optim.Optimizer.add_param_group)


class _EvaluationsUsedUp(Exception):
    """Ends a line search."""


def _error(network: ScaledNetwork, examples: ScaledExamples, sobolev_weight: float) -> Tensor:
    if sobolev_weight == 0.0 or examples.directions is None or examples.derivatives is None:
        return torch.mean((network.scaled(examples.inputs) - examples.targets) ** 2)
    outputs, derivatives = outputs_and_derivatives(network, examples.inputs, examples.directions)
    return torch.mean((outputs - examples.targets) ** 2) + sobolev_weight * torch.mean(
        (derivatives - examples.derivatives) ** 2
    )


def outputs_and_derivatives(
    network: ScaledNetwork, inputs: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Scaled outputs ``(n, k)`` and derivatives ``(n, d, k)`` along directions ``(n, d, m)``."""
    activations, derivatives = inputs, directions
    for layer in network.hidden.layers:
        assert isinstance(layer, nn.Linear)
        activations = torch.tanh(layer(activations))
        derivatives = (derivatives @ layer.weight.T) * (1.0 - activations**2).unsqueeze(1)
    outputs, derivatives = network.output(activations), derivatives @ network.output.weight.T
    if network.linear_path is not None:
        outputs = outputs + network.linear_path(inputs)
        derivatives = derivatives + directions @ network.linear_path.weight.T
    return outputs, derivatives
