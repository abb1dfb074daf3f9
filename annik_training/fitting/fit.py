"""Fit of a network: random restarts, held-out examples, and the choice of the best restart."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from annik_core.dataset import Dataset
from annik_core.errors import AnnikError
from annik_core.pose import FloatArray
from annik_training.fitting.branches import single_branch
from annik_training.fitting.evidence import minimise_with_chosen_decay
from annik_training.fitting.lbfgs import minimise_all_weights
from annik_training.fitting.levenberg_marquardt import one_thread
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem, System
from annik_training.fitting.variable_projection import ScaledExamples, SeparableProblem, minimise
from annik_training.networks.network import InverseKinematicsNetwork, ScaledNetwork, Scaling


class TooFewExamples(AnnikError):
    """A dataset is too small."""

    def __init__(self, examples: int, minimum: int, purpose: str) -> None:
        self.examples = examples
        self.minimum = minimum
        super().__init__(f"{examples} examples are too few for {purpose}: at least {minimum}")


#: Fewest examples of a fit that holds some of them out.
MIN_EXAMPLES = 8

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Examples:
    """Inputs and targets of a network, in the units of the system."""

    inputs: FloatArray  #: ``(n, m)``
    targets: FloatArray  #: ``(n, k)``
    target_box: tuple[FloatArray, FloatArray]  #: least and greatest targets, each ``(k,)``
    #: ``(n, m, dof)`` derivatives of the inputs by the joint positions, or None if the fit does
    #: not need them.
    input_jacobians: FloatArray | None = None
    target_jacobians: FloatArray | None = None  #: ``(n, k, dof)`` likewise
    #: ``(dof,)`` half the width of the joint box: the unit of joint motion in which derivatives
    #: are compared.
    joint_half_width: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.inputs)


def examples_of(
    system: System,
    joint_positions: FloatArray,
    options: FitOptions,
    inputs: FloatArray | None = None,
) -> Examples:
    """Examples of a system at joint positions ``(n, dof)``, with derivatives if the fit uses them.

    The inputs ``(n, m)`` are computed if they are not given.
    """
    sobolev = options.sobolev_weight > 0
    return Examples(
        system.inputs(joint_positions) if inputs is None else inputs,
        system.targets(joint_positions),
        system.target_box,
        system.input_jacobians(joint_positions) if sobolev else None,
        system.target_jacobians(joint_positions) if sobolev else None,
        0.5 * (system.joint_box.upper - system.joint_box.lower) if sobolev else None,
    )


def dataset_examples(
    system: InverseKinematicsSystem, dataset: Dataset, options: FitOptions
) -> Examples:
    """Examples of a dataset: its own poses, with the derivatives of the robot's model."""
    inputs = system.features(dataset.poses, dataset.joint_positions)
    return examples_of(system, dataset.joint_positions, options, inputs)


@dataclass(frozen=True, eq=False)
class Restart:
    """A fit from one set of random initial weights. Errors are mean squares of scaled targets."""

    number: int
    network: ScaledNetwork
    training_error: float  #: on the examples that were fitted
    held_out_error: float | None  #: on those that were held out; None if there are none
    evaluations: int  #: evaluations of the residual
    weight_decay: float  #: the ridge, or what the evidence chose; 0 with L-BFGS

    @property
    def choosing_error(self) -> float:
        """The held-out error, or else the training error: the least wins."""
        return self.training_error if self.held_out_error is None else self.held_out_error

    def to_dict(self) -> dict[str, Any]:
        """Everything but the network, as plain data."""
        return {name: value for name, value in vars(self).items() if name != "network"}


def best_of(restarts: tuple[Restart, ...]) -> Restart:
    """The restart with the least error on the held-out examples, or else on all."""
    return min(restarts, key=lambda restart: restart.choosing_error)


def held_out_rows(count: int, options: FitOptions) -> tuple[Indices, Indices]:
    """Indices of the examples that are held out, drawn at random, and of the others.

    Raises:
        TooFewExamples: if examples are held out and there are fewer than :data:`MIN_EXAMPLES`,
            or if there are none.
    """
    if options.held_out_fraction > 0 and count < MIN_EXAMPLES:
        raise TooFewExamples(count, MIN_EXAMPLES, "a fit with held-out examples")
    if count == 0:
        raise TooFewExamples(0, 1, "a fit")
    split_seed, *_ = _seeds(options)
    order = np.random.default_rng(split_seed).permutation(count)
    held_out = 0
    if options.held_out_fraction > 0:
        held_out = max(1, round(options.held_out_fraction * count))
    return order[:held_out], order[held_out:]


def fit_restarts(
    examples: Examples, options: FitOptions, on_restart: Callable[[Restart], None] | None = None
) -> tuple[Restart, ...]:
    """Fit a network from several sets of random initial weights.

    ``on_restart`` is called with each restart when it ends, such as for a progress bar.

    Raises:
        TooFewExamples: see :func:`held_out_rows`.
    """
    held_out, training = held_out_rows(len(examples), options)
    _, *restart_seeds = _seeds(options)
    restarts = []
    for number, seed in enumerate(restart_seeds):
        rng = np.random.default_rng(seed)
        restarts.append(fit_restart(examples, training, held_out, options, number, rng))
        if on_restart is not None:
            on_restart(restarts[-1])
    return tuple(restarts)


def fit_restart(
    examples: Examples,
    training: Indices,
    held_out: Indices,
    options: FitOptions,
    number: int,
    rng: np.random.Generator,
) -> Restart:
    """Fit one set of initial weights, drawn by ``rng``, to the examples of these indices.

    The inputs are scaled to the box of the training examples; those held out may be none.
    """
    network = untrained_network(examples, training, options)
    network.hidden.initialise(rng)
    scaled = scaled_examples(network, examples)
    with one_thread():
        if options.optimiser == "lbfgs":
            _zero_output_layer(network)
            evaluations = minimise_all_weights(
                network, scaled.rows(training), options.sobolev_weight, options.max_evaluations
            )
            training_error, decay = _error(network, scaled.rows(training)), 0.0
        else:
            training_error, evaluations, decay = _minimise_separably(
                network, scaled.rows(training), options
            )
        held_out_error = _error(network, scaled.rows(held_out)) if len(held_out) else None
    return Restart(number, network, training_error, held_out_error, evaluations, decay)


def untrained_network(examples: Examples, rows: Indices, options: FitOptions) -> ScaledNetwork:
    """A network of the right size, scaled to some of the examples, with arbitrary weights."""
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
        derivatives = torch.from_numpy(examples.target_jacobians) * motion
        return ScaledExamples(
            inputs,
            targets,
            directions.transpose(1, 2) / network.input_scaling.half_width,
            derivatives.transpose(1, 2) / network.output_scaling.half_width,
        )


@dataclass(frozen=True, eq=False)
class FittedNetwork:
    """A fitted network of inverse kinematics."""

    #: The network of the best restart, behind the encoding of poses.
    network: InverseKinematicsNetwork
    dataset: Dataset
    options: FitOptions
    restarts: tuple[Restart, ...]
    winner: int  #: number of the best one
    held_out: Indices  #: indices of the examples that only chose it
    #: Number of examples that were left out, see :mod:`annik_training.fitting.branches`.
    second_solutions: int
    seconds: float  #: wall time of the fit


def fit(
    dataset: Dataset, options: FitOptions, on_restart: Callable[[Restart], None] | None = None
) -> FittedNetwork:
    """Fit a network to a dataset; for ``on_restart`` see :func:`fit_restarts`.

    The restart with the smallest error on the held-out examples wins; nothing else chooses it.

    Raises:
        TooFewExamples: see :func:`held_out_rows`.
    """
    begin = time.perf_counter()
    system = InverseKinematicsSystem(dataset.robot)
    learned = single_branch(dataset.robot, dataset.joint_positions, dataset.poses)
    examples = dataset_examples(system, dataset.rows(learned), options)
    restarts = fit_restarts(examples, options, on_restart)
    held_out, _ = held_out_rows(len(examples), options)
    best = best_of(restarts)
    return FittedNetwork(
        InverseKinematicsNetwork(system.encoding, best.network),
        dataset,
        options,
        restarts,
        best.number,
        np.flatnonzero(learned)[held_out],
        int((~learned).sum()),
        time.perf_counter() - begin,
    )


def _seeds(options: FitOptions) -> list[np.random.SeedSequence]:
    """Seed of the held-out examples, then one for each restart."""
    return np.random.SeedSequence(options.seed).spawn(options.restarts + 1)


def _minimise_separably(
    network: ScaledNetwork, examples: ScaledExamples, options: FitOptions
) -> tuple[float, int, float]:
    """Fit by variable projection: the remaining error, evaluations, and the weight decay."""
    problem = SeparableProblem(
        network.hidden,
        examples,
        options.ridge,
        linear_path=options.linear_path,
        sobolev_weight=options.sobolev_weight,
        decay_hidden=options.bayesian_regularisation,
    )
    start = torch.cat(
        [value.detach().reshape(-1) for value in network.hidden.parameters()]
    ).numpy()
    find = minimise_with_chosen_decay if options.bayesian_regularisation else minimise
    weights, evaluations = find(problem, start, options.max_evaluations)
    problem.assign(weights)
    _copy_linear_layers(network, problem, weights)
    return problem.mean_square_error(weights), evaluations, problem.ridge


def _error(network: ScaledNetwork, examples: ScaledExamples) -> float:
    with torch.no_grad():
        return float(torch.mean((network.scaled(examples.inputs) - examples.targets) ** 2))


def _zero_output_layer(network: ScaledNetwork) -> None:
    """Zero what is behind the hidden layers, so that the fit starts at the centre of the box."""
    with torch.no_grad():
        for layer in (network.output, network.linear_path):
            for parameter in () if layer is None else layer.parameters():
                parameter.zero_()


def _copy_linear_layers(
    network: ScaledNetwork, problem: SeparableProblem, weights: FloatArray
) -> None:
    layers = problem.linear_layers(weights)
    with torch.no_grad():
        network.output.weight.copy_(layers.output)
        network.output.bias.copy_(layers.bias)
        if network.linear_path is not None:
            network.linear_path.weight.copy_(layers.linear_path)
