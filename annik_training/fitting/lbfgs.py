"""All weights at once by L-BFGS: for networks whose Jacobian is too large to factorise.

Minimises the mean square error of the targets and, with Sobolev training [Czarnecki2017]_, of the
slopes beside it, see :mod:`annik_training.fitting.variable_projection`. The slopes of a
network of tanh layers are carried forward with its activations, so one evaluation costs as much as
that of 1 + d times as many examples.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from annik_training.fitting.variable_projection import ScaledExamples
from annik_training.networks.network import ScaledNetwork

#: Pairs of steps and gradients that stand for the curvature.
_HISTORY = 50


def minimise_all_weights(
    network: ScaledNetwork, examples: ScaledExamples, slope_weight: float, max_evaluations: int
) -> int:
    """Fit all weights of a network, from those that it has; returns the evaluations it took.

    Args:
        network: the network; its weights are changed.
        examples: what to fit, scaled.
        slope_weight: weight of the mean square error of the slopes, where there are any.
        max_evaluations: most evaluations of error and gradient. Where they end within a line
            search, the best weights so far are taken.
    """
    optimiser = torch.optim.LBFGS(
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
            # The optimiser counts after a line search only.
            raise _EvaluationsUsedUp
        evaluations += 1
        optimiser.zero_grad()
        value = _error(network, examples, slope_weight)
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


class _EvaluationsUsedUp(Exception):
    """Ends a line search."""


def _error(network: ScaledNetwork, examples: ScaledExamples, slope_weight: float) -> Tensor:
    if slope_weight == 0.0 or examples.directions is None or examples.slopes is None:
        return torch.mean((network.scaled(examples.inputs) - examples.targets) ** 2)
    answers, slopes = answers_and_slopes(network, examples.inputs, examples.directions)
    return torch.mean((answers - examples.targets) ** 2) + slope_weight * torch.mean(
        (slopes - examples.slopes) ** 2
    )


def answers_and_slopes(
    network: ScaledNetwork, inputs: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Scaled outputs ``(n, k)`` and their derivatives ``(n, d, k)`` along directions.

    Args:
        network: the network.
        inputs: ``(n, m)`` scaled.
        directions: ``(n, d, m)``.
    """
    activations, slopes = inputs, directions
    for layer in network.hidden.layers:
        assert isinstance(layer, nn.Linear)
        activations = torch.tanh(layer(activations))
        slopes = (slopes @ layer.weight.T) * (1.0 - activations**2).unsqueeze(1)
    answers, answer_slopes = network.output(activations), slopes @ network.output.weight.T
    if network.linear_path is not None:
        answers = answers + network.linear_path(inputs)
        answer_slopes = answer_slopes + directions @ network.linear_path.weight.T
    return answers, answer_slopes
