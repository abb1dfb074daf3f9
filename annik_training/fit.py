"""Fit the inverse kinematics of a robot to a dataset."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from annik_core.dataset import Dataset
from annik_training.branches import single_branch
from annik_training.fitting.fit_network import Examples, Indices, Restart, examples_of, fit_starts
from annik_training.fitting.fit_options import FitOptions, default_options
from annik_training.fitting.network import InverseKinematicsNetwork
from annik_training.systems.inverse_kinematics_system import InverseKinematicsSystem


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
        second_solutions: how many examples were left out, see :mod:`annik_training.branches`.
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
        TooFewExamples: see :func:`annik_training.fitting.fit_network.fit_starts`.
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
