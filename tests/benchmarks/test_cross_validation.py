"""Cross-validation: networks, and examples that they have not seen. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from annik_core.errors import InvalidValue
from annik_training.designs.sampling_designs import sobol_design
from annik_training.fitting.fit import Examples, TooFewExamples, examples_of
from annik_training.fitting.options import FitOptions
from benchmarks.paper.cross_validation import cross_validate
from benchmarks.systems.elbow_arm import ElbowArm

QUICK = FitOptions(hidden_units=(5,), max_evaluations=6)


def some_examples(count: int = 30, options: FitOptions = QUICK) -> Examples:
    arm = ElbowArm()
    return examples_of(arm, sobol_design(arm.joint_box, count, np.random.default_rng(0)), options)


def test_every_example_is_validated_once() -> None:
    folds = cross_validate(some_examples(), 4, QUICK)
    assert [len(fold.validation) for fold in folds] == [8, 8, 7, 7]
    assert sorted(np.concatenate([fold.validation for fold in folds])) == list(range(30))


def test_the_errors_are_those_of_the_networks() -> None:
    """In scaled target units: on the fold, and on the others."""
    examples = some_examples()
    lower, upper = examples.target_box
    for fold in cross_validate(examples, 4, QUICK):
        off = (fold.network.predict(examples.inputs) - examples.targets) / (0.5 * (upper - lower))
        others = np.setdiff1d(np.arange(30), fold.validation)
        assert fold.validation_error == pytest.approx(np.mean(off[fold.validation] ** 2), rel=1e-6)
        assert fold.training_error == pytest.approx(np.mean(off[others] ** 2), rel=1e-6)


@pytest.mark.parametrize(
    "options",
    [QUICK, replace(QUICK, sobolev_weight=1.0, linear_path=True)],
    ids=["plain", "slopes"],
)
def test_a_fold_has_no_part_in_its_own_network(options: FitOptions) -> None:
    """Other values there: all networks change but that one, which stays bit for bit."""
    examples = some_examples(options=options)
    folds = cross_validate(examples, 4, options)
    targets, inputs = examples.targets.copy(), examples.inputs.copy()
    targets[folds[1].validation] += 1.0
    inputs[folds[1].validation] *= 2.0
    again = cross_validate(replace(examples, targets=targets, inputs=inputs), 4, options)
    same = [
        all(
            torch.equal(*pair)
            for pair in zip(
                one.network.state_dict().values(),
                other.network.state_dict().values(),
                strict=True,
            )
        )
        for one, other in zip(folds, again, strict=True)
    ]
    assert same == [False, True, False, False]


def test_same_seed_same_folds_and_errors() -> None:
    examples = some_examples()
    first, again = cross_validate(examples, 3, QUICK), cross_validate(examples, 3, QUICK)
    other = cross_validate(examples, 3, replace(QUICK, seed=1))
    assert [fold.validation_error for fold in first] == [fold.validation_error for fold in again]
    assert [fold.validation.tolist() for fold in first] != [
        fold.validation.tolist() for fold in other
    ]


def test_restarts_and_held_out_examples_have_no_part_in_it() -> None:
    examples = some_examples()
    first = cross_validate(examples, 3, QUICK)
    again = cross_validate(examples, 3, replace(QUICK, restarts=1, held_out_fraction=0.0))
    assert [fold.validation_error for fold in first] == [fold.validation_error for fold in again]


@pytest.mark.parametrize("folds", [1, 0, 31])
def test_a_number_of_folds_out_of_range(folds: int) -> None:
    with pytest.raises(InvalidValue) as raised:
        cross_validate(some_examples(), folds, QUICK)
    assert (raised.value.name, raised.value.value) == ("folds", folds)


def test_too_few_examples_for_the_folds() -> None:
    with pytest.raises(TooFewExamples, match="2 folds"):
        cross_validate(some_examples(15), 2, QUICK)
    assert len(cross_validate(some_examples(16), 2, QUICK)) == 2
