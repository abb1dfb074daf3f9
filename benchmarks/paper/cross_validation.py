"""k-fold cross-validation: every example is predicted once by a network that has not seen it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from annik_core.errors import InvalidValue
from annik_training.fitting.fit import MIN_EXAMPLES, Examples, Indices, TooFewExamples, fit_restart
from annik_training.fitting.options import FitOptions
from annik_training.networks.network import ScaledNetwork


@dataclass(frozen=True, eq=False)
class Fold:
    """One fold. Mean square errors are in scaled target units.

    Attributes:
        network: trained on the other folds.
        training_error: on the other folds.
        validation_error: on this fold.
        validation: indices of its examples.
    """

    network: ScaledNetwork
    training_error: float
    validation_error: float
    validation: Indices


def cross_validate(examples: Examples, folds: int, options: FitOptions) -> tuple[Fold, ...]:
    """Fit one network per fold, from one random start each.

    Args:
        examples: what to learn, dealt to the folds at random.
        folds: how many; the paper uses 4.
        options: how to fit; ``restarts`` and ``held_out_fraction`` have no part in it.

    Raises:
        InvalidValue: if there are fewer than two folds or more folds than examples.
        TooFewExamples: if a fold leaves too few examples to fit.
    """
    if not 2 <= folds <= len(examples):
        raise InvalidValue("folds", folds, f"2 to the {len(examples)} examples")
    split_seed, *start_seeds = np.random.SeedSequence(options.seed).spawn(folds + 1)
    order = np.random.default_rng(split_seed).permutation(len(examples))
    parts = np.array_split(order, folds)
    if len(examples) - len(parts[0]) < MIN_EXAMPLES:
        raise TooFewExamples(len(examples), MIN_EXAMPLES + len(parts[0]), f"{folds} folds")
    results = []
    for number, (part, start_seed) in enumerate(zip(parts, start_seeds, strict=True)):
        others = np.concatenate([other for other in parts if other is not part])
        restart = fit_restart(
            examples, others, part, options, number, np.random.default_rng(start_seed)
        )
        assert restart.held_out_error is not None
        results.append(Fold(restart.network, restart.training_error, restart.held_out_error, part))
    return tuple(results)
