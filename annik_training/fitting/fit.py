"""Fit of a network: restarts, held-out examples, and the choice among them.

Fit a network to examples of any system: several starts, the winner chosen on held-out ones.

Fit the inverse kinematics of a robot to a dataset.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from annik_core.dataset import Dataset
from annik_core.errors import AnnikError
from annik_core.pose import FloatArray
from annik_training.fitting.branches import single_branch
from annik_training.fitting.evidence import minimise_with_chosen_decay
from annik_training.fitting.lbfgs import minimise_all_weights
from annik_training.fitting.options import FitOptions, default_options
from annik_training.fitting.problem import InverseKinematicsSystem, System
from annik_training.fitting.threads import one_thread
from annik_training.fitting.variable_projection import ScaledExamples, SeparableProblem, minimise
from annik_training.networks.network import InverseKinematicsNetwork, ScaledNetwork, Scaling


class TooFewExamples(AnnikError):
    """A dataset is too small for what was asked of it."""

    def __init__(self, examples: int, minimum: int, purpose: str) -> None:
        self.examples = examples
        self.minimum = minimum
        super().__init__(f"{examples} examples are too few for {purpose}: at least {minimum}")


#: Fewest examples of a fit that holds some of them out.
MIN_EXAMPLES = 8

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Examples:
    """What a network is to learn, in the units of the system.

    Attributes:
        inputs: ``(n, m)`` what the network sees.
        targets: ``(n, k)`` what it should say.
        target_box: least and greatest targets, each ``(k,)``.
        input_jacobians: ``(n, m, dof)`` derivatives of the inputs in the joint positions, or None
            where they are not needed.
        target_jacobians: ``(n, k, dof)`` likewise.
        joint_half_width: ``(dof,)`` half the width of the joint box: the unit of a joint's motion
            by which slopes are compared.
    """

    inputs: FloatArray
    targets: FloatArray
    target_box: tuple[FloatArray, FloatArray]
    input_jacobians: FloatArray | None = None
    target_jacobians: FloatArray | None = None
    joint_half_width: FloatArray | None = None

    def __len__(self) -> int:
        """Number of examples."""
        return len(self.inputs)


def examples_of(
    system: System,
    joint_positions: FloatArray,
    options: FitOptions,
    inputs: FloatArray | None = None,
) -> Examples:
    """Examples of a system, with slopes if the fit wants them.

    Args:
        system: the system.
        joint_positions: ``(n, dof)`` [rad or m].
        options: how they will be fitted.
        inputs: ``(n, m)`` what the network sees there, if that is known already: the system's own
            can be slow to compute.
    """
    slopes = options.slope_weight > 0
    return Examples(
        system.inputs(joint_positions) if inputs is None else inputs,
        system.targets(joint_positions),
        system.target_box,
        system.input_jacobians(joint_positions) if slopes else None,
        system.target_jacobians(joint_positions) if slopes else None,
        0.5 * (system.joint_box.upper - system.joint_box.lower) if slopes else None,
    )


@dataclass(frozen=True, eq=False)
class Restart:
    """One start and where it ended. Mean square errors are in scaled target units.

    Attributes:
        number: which start.
        training_error: on the examples that were fitted.
        held_out_error: on those that were held out; None if there are none.
        evaluations: evaluations of the residual.
        weight_decay: the one used: the ridge, or what the evidence chose; L-BFGS has none.
    """

    number: int
    training_error: float
    held_out_error: float | None
    evaluations: int
    weight_decay: float

    @property
    def choosing_error(self) -> float:
        """What the winner has least of: the held-out error, or else the training error."""
        return self.training_error if self.held_out_error is None else self.held_out_error


@dataclass(frozen=True, eq=False)
class FittedStarts:
    """All starts of a fit.

    Attributes:
        networks: one per start.
        restarts: what is known of each.
        held_out: indices of the examples that only chose the winner.
    """

    networks: tuple[ScaledNetwork, ...]
    restarts: tuple[Restart, ...]
    held_out: Indices

    @property
    def winner(self) -> int:
        """The start with the least error on the held-out examples."""
        return min(self.restarts, key=lambda restart: restart.choosing_error).number

    @property
    def network(self) -> ScaledNetwork:
        """The winner's network."""
        return self.networks[self.winner]


def fit_starts(
    examples: Examples,
    options: FitOptions,
    on_restart: Callable[[Restart], None] | None = None,
) -> FittedStarts:
    """Fit a network from several random starts.

    Some examples, drawn at random, are held out, and each start is fitted to the others.

    Args:
        examples: what to learn.
        options: how to fit.
        on_restart: told of each start as it ends, for a progress bar.

    Raises:
        TooFewExamples: if examples are held out and there are fewer than :data:`MIN_EXAMPLES`,
            or if there are none.
    """
    if options.held_out_fraction > 0 and len(examples) < MIN_EXAMPLES:
        raise TooFewExamples(len(examples), MIN_EXAMPLES, "a fit with held-out examples")
    if len(examples) == 0:
        raise TooFewExamples(0, 1, "a fit")
    split_seed, *start_seeds = np.random.SeedSequence(options.seed).spawn(options.restarts + 1)
    order = np.random.default_rng(split_seed).permutation(len(examples))
    held_out_count = 0
    if options.held_out_fraction > 0:
        held_out_count = max(1, round(options.held_out_fraction * len(examples)))
    held_out, training = order[:held_out_count], order[held_out_count:]
    fits = []
    for number, start_seed in enumerate(start_seeds):
        rng = np.random.default_rng(start_seed)
        fits.append(fit_start(examples, training, held_out, options, number, rng))
        if on_restart is not None:
            on_restart(fits[-1][1])
    networks, restarts = zip(*fits, strict=True)
    return FittedStarts(networks, restarts, held_out)


def fit_start(
    examples: Examples,
    training: Indices,
    held_out: Indices,
    options: FitOptions,
    number: int,
    rng: np.random.Generator,
) -> tuple[ScaledNetwork, Restart]:
    """Fit one random start to some of the examples and measure it on others.

    Args:
        examples: what to learn.
        training: indices of the examples to fit; the inputs are scaled to their box.
        held_out: indices of the examples to measure on, possibly none.
        options: how to fit.
        number: which start this is.
        rng: what the start is drawn from.
    """
    network = untrained_network(examples, training, options)
    network.hidden.initialise(rng)
    scaled = scaled_examples(network, examples)
    with one_thread():
        if options.optimiser == "lbfgs":
            _silence(network)
            evaluations = minimise_all_weights(
                network, scaled.rows(training), options.slope_weight, options.max_evaluations
            )
            training_error, decay = _error(network, scaled.rows(training)), 0.0
        else:
            training_error, evaluations, decay = _minimise_separably(
                network, scaled.rows(training), options
            )
        held_out_error = _error(network, scaled.rows(held_out)) if len(held_out) else None
    return network, Restart(number, training_error, held_out_error, evaluations, decay)


def _minimise_separably(
    network: ScaledNetwork, examples: ScaledExamples, options: FitOptions
) -> tuple[float, int, float]:
    """Fit by variable projection: the error that is left, evaluations, and the weight decay."""
    problem = SeparableProblem(
        network.hidden,
        examples,
        options.ridge,
        linear_path=options.linear_path,
        slope_weight=options.slope_weight,
        decay_hidden=options.bayesian_regularisation,
    )
    start = torch.cat(
        [value.detach().reshape(-1) for value in network.hidden.parameters()]
    ).numpy()
    find = minimise_with_chosen_decay if options.bayesian_regularisation else minimise
    weights, evaluations = find(problem, start, options.max_evaluations)
    problem.assign(weights)
    _take_over(network, problem, weights)
    return problem.mean_square_error(weights), evaluations, problem.ridge


def untrained_network(examples: Examples, rows: Indices, options: FitOptions) -> ScaledNetwork:
    """A network of the right size, scaled to some of the examples; its weights mean nothing."""
    inputs = examples.inputs[rows]
    return ScaledNetwork(
        options.hidden_units,
        Scaling(inputs.min(axis=0), inputs.max(axis=0)),
        Scaling(*(bound.copy() for bound in examples.target_box)),
        linear_path=options.linear_path,
    )


def scaled_examples(network: ScaledNetwork, examples: Examples) -> ScaledExamples:
    """Examples in the scaled units of a network; joint motions in half widths of the box."""
    with torch.no_grad():
        inputs = network.input_scaling.scale(torch.from_numpy(examples.inputs))
        targets = network.output_scaling.scale(torch.from_numpy(examples.targets))
        if examples.input_jacobians is None:
            return ScaledExamples(inputs, targets)
        assert examples.target_jacobians is not None and examples.joint_half_width is not None
        motion = torch.from_numpy(examples.joint_half_width)
        # (n, m, dof) to (n, dof, m): one direction for each joint.
        directions = torch.from_numpy(examples.input_jacobians) * motion
        slopes = torch.from_numpy(examples.target_jacobians) * motion
        return ScaledExamples(
            inputs,
            targets,
            directions.transpose(1, 2) / network.input_scaling.half_width,
            slopes.transpose(1, 2) / network.output_scaling.half_width,
        )


def _error(network: ScaledNetwork, examples: ScaledExamples) -> float:
    with torch.no_grad():
        return float(torch.mean((network.scaled(examples.inputs) - examples.targets) ** 2))


def _silence(network: ScaledNetwork) -> None:
    """Let it answer zero, the centre of the targets: a gentle start for all weights at once."""
    with torch.no_grad():
        for layer in (network.output, network.linear_path):
            for parameter in () if layer is None else layer.parameters():
                parameter.zero_()


def _take_over(network: ScaledNetwork, problem: SeparableProblem, weights: FloatArray) -> None:
    layers = problem.linear_layers(weights)
    with torch.no_grad():
        network.output.weight.copy_(layers.output)
        network.output.bias.copy_(layers.bias)
        if network.linear_path is not None:
            network.linear_path.weight.copy_(layers.linear_path)


@dataclass(frozen=True, eq=False)
class FittedNetwork:
    """A trained network and how it came about.

    Attributes:
        network: the winner.
        dataset: what it was trained on.
        options: how.
        restarts: every start.
        winner: which one won.
        held_out: indices of the examples that only chose it.
        second_solutions: how many examples were left out, see :mod:`branches`.
        seconds: wall time of the fit.
    """

    network: InverseKinematicsNetwork
    dataset: Dataset
    options: FitOptions
    restarts: tuple[Restart, ...]
    winner: int
    held_out: Indices
    second_solutions: int
    seconds: float


def fit(
    dataset: Dataset,
    options: FitOptions | None = None,
    on_restart: Callable[[Restart], None] | None = None,
) -> FittedNetwork:
    """Fit a network to a dataset.

    Some examples, drawn at random, are held out; each start is fitted to the others, and the start
    with the smallest error on the held-out ones wins. Nothing else chooses it.

    Args:
        dataset: the examples.
        options: how to fit; left out, as suits the kind of robot.
        on_restart: told of each start as it ends, for a progress bar.

    Raises:
        TooFewExamples: see :func:`annik_training.fitting.fit.fit_starts`.
    """
    options = options or default_options(dataset.robot.kind)
    begin = time.perf_counter()
    system = InverseKinematicsSystem(dataset.robot)
    learned = single_branch(dataset.robot, dataset.joint_positions, dataset.poses)
    examples = dataset_examples(system, dataset.rows(learned), options)
    fitted = fit_starts(examples, options, on_restart)
    return FittedNetwork(
        InverseKinematicsNetwork(system.encoding, fitted.network),
        dataset,
        options,
        fitted.restarts,
        fitted.winner,
        np.flatnonzero(learned)[fitted.held_out],
        int((~learned).sum()),
        time.perf_counter() - begin,
    )


def dataset_examples(
    system: InverseKinematicsSystem, dataset: Dataset, options: FitOptions
) -> Examples:
    """The examples of a dataset: its own poses, with the slopes of the robot's model."""
    inputs = system.features(dataset.poses, dataset.joint_positions)
    return examples_of(system, dataset.joint_positions, options, inputs)
