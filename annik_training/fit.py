"""Fit a network to a dataset: several starts, the winner chosen on held-out examples."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from annik_core.errors import InvalidTrainingOption, TooFewExamples
from annik_core.gantry import GantryWorkspace
from annik_core.pose import FloatArray
from annik_core.robot import Robot
from annik_training.dataset import Dataset
from annik_training.network import InverseKinematicsNetwork, Scaling
from annik_training.pose_encoding import PositionRollPitchYaw
from annik_training.separable_least_squares import fit_separable

MIN_EXAMPLES = 8


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        hidden_units: sizes of the hidden layers; the paper's network has one of 20.
        restarts: how many random starts to fit; the best on the held-out examples wins.
        held_out_fraction: part of the examples that only choose the winner.
        max_evaluations: most evaluations of the residual per start.
        ridge: see :class:`annik_training.separable_least_squares.SeparableProblem`.
        seed: everything random is drawn from it.

    Raises:
        InvalidTrainingOption: naming the option and what is allowed.
    """

    hidden_units: tuple[int, ...] = (20,)
    restarts: int = 6
    held_out_fraction: float = 0.15
    max_evaluations: int = 50
    ridge: float = 1e-7
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuse options that make no sense."""
        for option, valid, allowed in (
            (
                "hidden_units",
                0 < len(self.hidden_units) <= 8 and all(1 <= n <= 4096 for n in self.hidden_units),
                "1 to 8 layers of 1 to 4096 units",
            ),
            ("restarts", 1 <= self.restarts <= 1000, "1 to 1000"),
            ("held_out_fraction", 0 < self.held_out_fraction <= 0.5, "more than 0, at most 0.5"),
            ("max_evaluations", 1 <= self.max_evaluations <= 100_000, "1 to 100000"),
            ("ridge", 0 < self.ridge <= 1, "more than 0, at most 1"),
            ("seed", 0 <= self.seed < 2**63, "0 to 2^63 - 1"),
        ):
            if not valid:
                raise InvalidTrainingOption(option, getattr(self, option), allowed)

    def as_plain_data(self) -> dict[str, Any]:
        """The options for a model's metadata."""
        return {**asdict(self), "hidden_units": list(self.hidden_units)}


@dataclass(frozen=True, eq=False)
class Restart:
    """One start and where it ended. Mean square errors are in scaled joint units."""

    number: int
    training_error: float
    held_out_error: float
    evaluations: int


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
        seconds: wall time of the fit.
    """

    network: InverseKinematicsNetwork
    dataset: Dataset
    options: FitOptions
    restarts: tuple[Restart, ...]
    winner: int
    held_out: NDArray[np.int64]
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
        options: how to fit.
        on_restart: told of each start as it ends, for a progress bar.

    Raises:
        TooFewExamples: if there are fewer than :data:`MIN_EXAMPLES`.
    """
    options = options or FitOptions()
    if len(dataset) < MIN_EXAMPLES:
        raise TooFewExamples(len(dataset), MIN_EXAMPLES, "a fit with held-out examples")
    begin = time.perf_counter()
    split_seed, *start_seeds = np.random.SeedSequence(options.seed).spawn(options.restarts + 1)
    order = np.random.default_rng(split_seed).permutation(len(dataset))
    held_out_count = max(1, round(options.held_out_fraction * len(dataset)))
    held_out, training = order[:held_out_count], order[held_out_count:]
    poses = network_poses(dataset)
    best: InverseKinematicsNetwork | None = None
    restarts: list[Restart] = []
    for number, start_seed in enumerate(start_seeds):
        network, restart = fit_once(
            dataset,
            poses,
            training,
            held_out,
            options,
            number,
            np.random.default_rng(start_seed),
        )
        if best is None or restart.held_out_error < min(r.held_out_error for r in restarts):
            best = network
        restarts.append(restart)
        if on_restart is not None:
            on_restart(restart)
    assert best is not None
    winner = min(restarts, key=lambda restart: restart.held_out_error).number
    return FittedNetwork(
        best,
        dataset,
        options,
        tuple(restarts),
        winner,
        held_out,
        time.perf_counter() - begin,
    )


def fit_once(
    dataset: Dataset,
    poses: FloatArray,
    training: NDArray[np.int64],
    held_out: NDArray[np.int64],
    options: FitOptions,
    number: int,
    rng: np.random.Generator,
) -> tuple[InverseKinematicsNetwork, Restart]:
    """Fit one random start to some of the examples and measure it on others.

    Args:
        dataset: the examples.
        poses: ``(n, 7)`` their poses as the network should see them; see :func:`network_poses`.
        training: indices of the examples to fit.
        held_out: indices of the examples to measure on.
        options: how to fit.
        number: which start this is.
        rng: what the start is drawn from.
    """
    network = untrained_network(dataset.robot, poses[training], options)
    network.hidden.initialise(rng)
    inputs, targets = scaled_examples(network, poses, dataset.joint_positions)
    with _one_thread():
        solution = fit_separable(
            network.hidden,
            inputs[training],
            targets[training],
            options.ridge,
            options.max_evaluations,
        )
        with torch.no_grad():
            network.output.weight.copy_(solution.output_weight)
            network.output.bias.copy_(solution.output_bias)
            answer = network.output(network.hidden(inputs[held_out]))
            held_out_error = float(torch.mean((answer - targets[held_out]) ** 2))
    return network, Restart(
        number, solution.mean_square_error, held_out_error, solution.evaluations
    )


def network_poses(dataset: Dataset) -> FloatArray:
    """The poses ``(n, 7)`` of a dataset as the network should see them.

    Where a pose leaves the choice between several joint positions, it is made unambiguous by the
    example's own, just as the solver does by the previous command.
    """
    workspace = dataset.robot.workspace
    return np.array(
        [
            workspace.resolve(pose, workspace.reference(joint_positions)).pose
            for pose, joint_positions in zip(dataset.poses, dataset.joint_positions, strict=True)
        ]
    )


def untrained_network(
    robot: Robot, poses: FloatArray, options: FitOptions
) -> InverseKinematicsNetwork:
    """A network of the right size for a robot, scaled to its examples; its weights mean nothing.

    Args:
        robot: the robot; the outputs are scaled to its joint box.
        poses: ``(n, 7)`` see :func:`network_poses`; the inputs are scaled to their features.
        options: of these, the hidden units.
    """
    workspace = robot.workspace
    assert isinstance(workspace, GantryWorkspace)
    encoding = PositionRollPitchYaw(0.5 * (workspace.lower[3:] + workspace.upper[3:]))
    with torch.no_grad():
        features = encoding(torch.from_numpy(poses)).numpy()
    return InverseKinematicsNetwork(
        encoding,
        options.hidden_units,
        Scaling(features.min(axis=0), features.max(axis=0)),
        Scaling(robot.joint_box.lower.copy(), robot.joint_box.upper.copy()),
    )


def scaled_examples(
    network: InverseKinematicsNetwork, poses: FloatArray, joint_positions: FloatArray
) -> tuple[Tensor, Tensor]:
    """Inputs ``(n, features)`` and targets ``(n, dof)`` of a network's layers, scaled."""
    with torch.no_grad():
        features = network.encoding(torch.from_numpy(poses))
        inputs: Tensor = network.feature_scaling.scale(features)
        targets: Tensor = network.joint_scaling.scale(torch.from_numpy(joint_positions))
    return inputs, targets


@contextmanager
def _one_thread() -> Iterator[None]:
    """These matrices are too small to share out; threads cost time and reproducibility."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
