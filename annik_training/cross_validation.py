"""k-fold cross-validation: every example is predicted once by a network that has not seen it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from annik_core.errors import InvalidTrainingOption, TooFewExamples
from annik_training.dataset import Dataset
from annik_training.fit import MIN_EXAMPLES, FitOptions, fit_once, network_poses
from annik_training.network import InverseKinematicsNetwork


@dataclass(frozen=True, eq=False)
class Fold:
    """One fold. Mean square errors are in scaled joint units.

    Attributes:
        network: trained on the other folds.
        training_error: on the other folds.
        validation_error: on this fold.
        validation: indices of its examples.
    """

    network: InverseKinematicsNetwork
    training_error: float
    validation_error: float
    validation: NDArray[np.int64]


def cross_validate(dataset: Dataset, folds: int, options: FitOptions) -> tuple[Fold, ...]:
    """Fit one network per fold, from one random start each.

    Args:
        dataset: the examples, dealt to the folds at random.
        folds: how many; the paper uses 4.
        options: how to fit; ``restarts`` and ``held_out_fraction`` have no part in it.

    Raises:
        InvalidTrainingOption: if there are fewer than two folds or more folds than examples.
        TooFewExamples: if a fold leaves too few examples to fit.
    """
    if not 2 <= folds <= len(dataset):
        raise InvalidTrainingOption("folds", folds, f"2 to the {len(dataset)} examples")
    split_seed, *start_seeds = np.random.SeedSequence(options.seed).spawn(folds + 1)
    order = np.random.default_rng(split_seed).permutation(len(dataset))
    parts = np.array_split(order, folds)
    if len(dataset) - len(parts[0]) < MIN_EXAMPLES:
        raise TooFewExamples(len(dataset), MIN_EXAMPLES + len(parts[0]), f"{folds} folds")
    poses = network_poses(dataset)
    results = []
    for number, (part, start_seed) in enumerate(zip(parts, start_seeds, strict=True)):
        others = np.concatenate([other for other in parts if other is not part])
        network, restart = fit_once(
            dataset, poses, others, part, options, number, np.random.default_rng(start_seed)
        )
        results.append(Fold(network, restart.training_error, restart.held_out_error, part))
    return tuple(results)
