"""Fits of any system: what they learn, what they hold out, that they repeat. ROS-free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from support.processes import run_python

from annik_core.robots.joint_limits import JointLimits
from annik_core.robots.robot import Robot
from annik_training.designs.sampling_designs import random_design, sobol_design
from annik_training.fitting.fit import (
    Examples,
    TooFewExamples,
    best_of,
    examples_of,
    fit_restarts,
    held_out_rows,
    scaled_examples,
    untrained_network,
)
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem, System
from annik_training.fitting.variable_projection import SeparableProblem
from annik_training.networks.network import ScaledNetwork
from benchmarks.systems.elbow_arm import ElbowArm
from benchmarks.systems.function_system import paper_functions
from benchmarks.systems.library import RobotSystem

QUICK = FitOptions(hidden_units=(4,), restarts=2, max_evaluations=12)

OPTIONS: tuple[dict[str, object], ...] = (
    {},
    {"linear_path": True},
    {"sobolev_weight": 1.0},
    {"bayesian_regularisation": True},
    {"hidden_units": (3, 4)},
    {"linear_path": True, "sobolev_weight": 1.0, "bayesian_regularisation": True},
)
WITHOUT_HELD_OUT: dict[str, object] = {"held_out_fraction": 0.0}


def each_of(*options: dict[str, object]) -> pytest.MarkDecorator:
    ids = ["+".join(option) or "default" for option in options]
    return pytest.mark.parametrize("option", options, ids=ids)


def sobol_examples(system: System, count: int, options: FitOptions, seed: int = 0) -> Examples:
    joint_positions = sobol_design(system.joint_box, count, np.random.default_rng(seed))
    return examples_of(system, joint_positions, options)


def mean_square_error(system: System, network: ScaledNetwork) -> float:
    """On unseen joint positions, in units of half the target box."""
    unseen = random_design(system.joint_box, 300, np.random.default_rng(99))
    lower, upper = system.target_box
    off = network.predict(system.inputs(unseen)) - system.targets(unseen)
    return float(np.mean((off / (0.5 * (upper - lower))) ** 2))


def same_layers(one: ScaledNetwork, other: ScaledNetwork) -> bool:
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(*pair) for pair in pairs)


@dataclass(frozen=True)
class OddSystem:
    """Two joints, three inputs, four outputs, different boxes: nothing fits transposed."""

    name: str = "odd"

    @property
    def joint_box(self) -> JointLimits:
        return JointLimits(("long", "short"), np.array([-1.0, 2.0]), np.array([3.0, 2.5]))

    @property
    def target_box(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([-30.0, -1.0, 0.0, -5.0]), np.array([30.0, 1.0, 20.0, 35.0])

    def inputs(self, q: np.ndarray) -> np.ndarray:
        return np.column_stack([q[:, 0] * q[:, 1], 100.0 * q[:, 1], np.sin(q[:, 0])])

    def targets(self, q: np.ndarray) -> np.ndarray:
        first, second = q.T
        return np.column_stack(
            [first**3, np.cos(second), first * second**2, np.exp(first) + second]
        )

    def input_jacobians(self, q: np.ndarray) -> np.ndarray:
        return derivatives(self.inputs, q)

    def target_jacobians(self, q: np.ndarray) -> np.ndarray:
        return derivatives(self.targets, q)


def derivatives(function: Callable[[np.ndarray], np.ndarray], q: np.ndarray) -> np.ndarray:
    """Central differences ``(n, k, dof)``."""
    step = 1e-5
    moves = step * np.eye(q.shape[1])
    return np.stack([(function(q + m) - function(q - m)) / (2.0 * step) for m in moves], axis=2)


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize("linear_path", [False, True])
def test_derivatives_are_those_of_the_finished_network_by_the_joints(linear_path: bool) -> None:
    """In joint motions of half the box's width, and targets of half the target box's."""
    system, weight = OddSystem(), 0.7
    options = FitOptions(
        hidden_units=(5,),
        held_out_fraction=0.0,
        restarts=1,
        max_evaluations=2,
        sobolev_weight=weight,
        linear_path=linear_path,
    )
    q = random_design(system.joint_box, 11, np.random.default_rng(0))
    examples = examples_of(system, q, options)
    network = fit_restarts(examples, options)[0].network

    half_target = 0.5 * (system.target_box[1] - system.target_box[0])
    half_joint = np.array([2.0, 0.25])
    value_error = (network.predict(system.inputs(q)) - system.targets(q)) / half_target
    learned = derivatives(lambda positions: network.predict(system.inputs(positions)), q)
    derivative_error = (
        (learned - system.target_jacobians(q)) * half_joint / half_target[:, np.newaxis]
    )

    problem = SeparableProblem(
        network.hidden,
        scaled_examples(network, examples),
        options.ridge,
        linear_path=linear_path,
        sobolev_weight=weight,
    )
    hidden = np.concatenate([p.detach().numpy().reshape(-1) for p in network.hidden.parameters()])
    assert np.mean(derivative_error**2) > 1e-4
    assert problem.squared_residual(hidden) == pytest.approx(
        np.sum(value_error**2) + weight * np.sum(derivative_error**2), rel=1e-6
    )
    assert problem.mean_square_error(hidden) == pytest.approx(np.mean(value_error**2), rel=1e-6)


def test_inputs_are_scaled_to_the_examples_and_targets_to_their_box() -> None:
    system = OddSystem()
    examples = sobol_examples(system, 16, QUICK)
    rows = np.arange(3, 12)
    network = untrained_network(examples, rows, QUICK)
    scaled = scaled_examples(network, examples)
    assert scaled.inputs[rows].numpy().min(axis=0) == pytest.approx([-1.0] * 3)
    assert scaled.inputs[rows].numpy().max(axis=0) == pytest.approx([1.0] * 3)
    lower, upper = system.target_box
    expected = 2.0 * (examples.targets - lower) / (upper - lower) - 1.0
    assert scaled.targets.numpy() == pytest.approx(expected)


@each_of(*OPTIONS, WITHOUT_HELD_OUT)
def test_same_seed_same_network(option: dict[str, object]) -> None:
    """Bit for bit on one machine; another seed gives another network."""
    options = replace(QUICK, **option)
    examples = sobol_examples(ElbowArm(), 20, options)
    first, again = fit_restarts(examples, options), fit_restarts(examples, options)
    other = fit_restarts(examples, replace(options, seed=1))
    for one, same, different in zip(first, again, other, strict=True):
        assert one.to_dict() == same.to_dict()
        assert same_layers(one.network, same.network)
        assert not same_layers(one.network, different.network)


def test_restarts_differ() -> None:
    first, second = fit_restarts(sobol_examples(ElbowArm(), 20, QUICK), QUICK)
    assert not same_layers(first.network, second.network)
    assert (first.number, second.number) == (0, 1)


@each_of(*OPTIONS, WITHOUT_HELD_OUT)
def test_the_errors_are_those_of_the_networks(option: dict[str, object]) -> None:
    """Of each start, on the held-out examples and on the others; in scaled units."""
    options = replace(QUICK, **option)
    system = ElbowArm()
    examples = sobol_examples(system, 20, options)
    half_width = 0.5 * (system.target_box[1] - system.target_box[0])
    held_out, training = held_out_rows(20, options)
    assert sorted([*held_out, *training]) == list(range(20))
    assert len(held_out) == (0 if "held_out_fraction" in option else 3)
    for restart in fit_restarts(examples, options):
        off = (restart.network.predict(examples.inputs) - examples.targets) / half_width
        assert restart.training_error == pytest.approx(np.mean(off[training] ** 2), rel=1e-6)
        if len(held_out):
            held_out_error = np.mean(off[held_out] ** 2)
            assert restart.held_out_error == pytest.approx(held_out_error, rel=1e-6)
        assert restart.evaluations <= options.max_evaluations
        if not options.bayesian_regularisation:
            assert restart.weight_decay == options.ridge


def test_the_winner_has_the_smallest_held_out_error() -> None:
    told = []
    options = replace(QUICK, restarts=5, max_evaluations=4)
    restarts = fit_restarts(sobol_examples(ElbowArm(), 30, options), options, told.append)
    assert tuple(told) == restarts
    errors = [restart.held_out_error for restart in restarts]
    assert errors == [restart.choosing_error for restart in restarts]
    assert best_of(restarts) is restarts[int(np.argmin(errors))]


def test_without_held_out_examples_all_are_fitted_and_the_training_error_chooses() -> None:
    options = replace(QUICK, restarts=5, max_evaluations=4, held_out_fraction=0.0)
    restarts = fit_restarts(sobol_examples(ElbowArm(), 30, options), options)
    assert [restart.held_out_error for restart in restarts] == [None] * 5
    errors = [restart.training_error for restart in restarts]
    assert best_of(restarts) is restarts[int(np.argmin(errors))]


@each_of(*OPTIONS)
def test_held_out_examples_have_no_part_in_a_restart(option: dict[str, object]) -> None:
    """Other values and derivatives there, the same network bit for bit."""
    options = replace(QUICK, **option, restarts=1)
    examples = sobol_examples(ElbowArm(), 30, options)
    (fitted,) = fit_restarts(examples, options)
    held_out, _ = held_out_rows(30, options)

    def other(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        changed = values.copy()
        changed[held_out] = 10.0 - 3.0 * values[held_out]
        return changed

    (again,) = fit_restarts(
        replace(
            examples,
            inputs=other(examples.inputs),
            targets=other(examples.targets),
            input_jacobians=other(examples.input_jacobians),
            target_jacobians=other(examples.target_jacobians),
        ),
        options,
    )
    assert same_layers(fitted.network, again.network)
    assert again.training_error == fitted.training_error
    assert again.held_out_error != fitted.held_out_error


@pytest.mark.parametrize("count", [0, 1, 7])
def test_too_few_examples_to_hold_some_out(count: int) -> None:
    examples = examples_of(ElbowArm(), np.zeros((count, 3)), QUICK)
    with pytest.raises(TooFewExamples) as caught:
        fit_restarts(examples, QUICK)
    assert (caught.value.examples, caught.value.minimum) == (count, 8)


def test_some_are_held_out_however_small_the_fraction() -> None:
    held_out, training = held_out_rows(8, replace(QUICK, held_out_fraction=1e-6))
    assert (len(held_out), len(training)) == (1, 7)


def test_threads_are_left_as_they_were() -> None:
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        fit_restarts(sobol_examples(ElbowArm(), 8, QUICK), QUICK)
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)


class TestLinearPath:
    OPTIONS = FitOptions(restarts=1, max_evaluations=20, held_out_fraction=0.0, linear_path=True)

    @pytest.mark.parametrize("bayesian", [False, True])
    def test_an_affine_robot_is_learned_exactly_from_seven_examples(
        self, gantry: Robot, bayesian: bool
    ) -> None:
        """One more than it has joints; to a millionth of a micrometre."""
        options = replace(self.OPTIONS, bayesian_regularisation=bayesian)
        system = RobotSystem(gantry)
        network = fit_restarts(sobol_examples(system, 7, options), options)[0].network
        unseen = random_design(system.joint_box, 300, np.random.default_rng(1))
        assert system.errors(unseen, network.predict(system.inputs(unseen))).max() < 1e-9

    @pytest.mark.parametrize("bayesian", [False, True])
    @pytest.mark.parametrize("count", [1, 2, 6])
    def test_of_fewer_it_makes_the_flattest_plane_through_them(
        self, gantry: Robot, count: int, bayesian: bool
    ) -> None:
        """Least A and b in scaled units: the pseudo-inverse."""
        options = replace(self.OPTIONS, bayesian_regularisation=bayesian)
        system = InverseKinematicsSystem(gantry)
        examples = sobol_examples(system, count, options)
        network = fit_restarts(examples, options)[0].network
        assert network.predict(examples.inputs) == pytest.approx(examples.targets, abs=1e-9)
        scaled = scaled_examples(network, examples)
        affine = np.column_stack([scaled.inputs.numpy(), np.ones(count)])
        least = np.linalg.pinv(affine, rcond=1e-12) @ scaled.targets.numpy()
        assert network.linear_path is not None
        assert network.linear_path.weight.detach().numpy() == pytest.approx(least[:-1].T, abs=1e-6)
        assert network.output.bias.detach().numpy() == pytest.approx(least[-1], abs=1e-6)

    def test_examples_in_a_plane_are_learned_in_the_plane(self, gantry: Robot) -> None:
        """Twenty of them, in which two joints stand still and two move together."""
        system = RobotSystem(gantry)
        rng = np.random.default_rng(0)

        def in_the_plane(count: int) -> np.ndarray:
            q = random_design(system.joint_box, count, rng)
            q[:, :2] = system.joint_box.centre[:2]
            q[:, 3] = system.joint_box.centre[3] + 0.1 * (q[:, 2] - system.joint_box.centre[2])
            return q

        examples = examples_of(system, in_the_plane(20), self.OPTIONS)
        (fitted,) = fit_restarts(examples, self.OPTIONS)
        unseen = in_the_plane(50)
        outputs = fitted.network.predict(system.inputs(unseen))
        assert system.errors(unseen, outputs).max() < 1e-6

    def test_without_it_seven_examples_are_not_enough(self, gantry: Robot) -> None:
        options = replace(self.OPTIONS, linear_path=False)
        system = InverseKinematicsSystem(gantry)
        network = fit_restarts(sobol_examples(system, 7, options), options)[0].network
        assert mean_square_error(system, network) > 1e-6


class TestDerivatives:
    @pytest.mark.parametrize(
        ("system", "count", "factor"), [(paper_functions(), 12, 100.0), (ElbowArm(), 20, 4.0)]
    )
    def test_examples_with_derivatives_teach_more(
        self, system: System, count: int, factor: float
    ) -> None:
        """Median of three seeds."""
        errors: dict[float, list[float]] = {0.0: [], 1.0: []}
        for weight, found in errors.items():
            for seed in range(3):
                options = FitOptions(
                    restarts=1,
                    max_evaluations=12,
                    held_out_fraction=0.0,
                    sobolev_weight=weight,
                    seed=seed,
                )
                examples = sobol_examples(system, count, options, seed)
                network = fit_restarts(examples, options)[0].network
                found.append(mean_square_error(system, network))
        assert np.median(errors[1.0]) < np.median(errors[0.0]) / factor

    def test_they_are_computed_only_if_they_are_wanted(self) -> None:
        without = sobol_examples(ElbowArm(), 8, QUICK)
        assert without.input_jacobians is without.target_jacobians is None
        with_derivatives = sobol_examples(ElbowArm(), 8, replace(QUICK, sobolev_weight=1e-3))
        assert with_derivatives.input_jacobians is not None
        assert with_derivatives.joint_half_width == pytest.approx(np.radians([75.0, 30.0, 45.0]))


class TestBayesianRegularisation:
    OPTIONS = FitOptions(hidden_units=(16,), restarts=1, max_evaluations=40, held_out_fraction=0.0)

    def fit_with_noise(
        self, gantry: Robot, noise: float, seed: int, bayesian: bool
    ) -> tuple[float, float]:
        """Error on unseen poses, and weight decay; noise in units of half the joint box."""
        options = replace(self.OPTIONS, bayesian_regularisation=bayesian, seed=seed)
        system = InverseKinematicsSystem(gantry)
        exact = sobol_examples(system, 40, options, seed)
        half_width = 0.5 * (system.joint_box.upper - system.joint_box.lower)
        off = np.random.default_rng(seed).normal(size=exact.targets.shape) * half_width
        noisy = replace(exact, targets=exact.targets + noise * off)
        (fitted,) = fit_restarts(noisy, options)
        return mean_square_error(system, fitted.network), fitted.weight_decay

    def test_noisy_examples_are_learned_better(self, gantry: Robot) -> None:
        """At a noise of 1 %, with about as many weights as numbers; median of three seeds."""
        errors: dict[bool, list[float]] = {False: [], True: []}
        for bayesian, found in errors.items():
            for seed in range(3):
                error, decay = self.fit_with_noise(gantry, 0.01, seed, bayesian)
                found.append(error)
                assert decay > 3e-3 if bayesian else decay == FitOptions.ridge
        assert np.median(errors[True]) < 0.7 * np.median(errors[False])

    def test_exact_examples_hardly_decay(self, gantry: Robot) -> None:
        error, decay = self.fit_with_noise(gantry, 0.0, seed=0, bayesian=True)
        assert decay < 1e-3
        assert error < 1e-4


@pytest.mark.process
def test_a_fit_does_not_load_the_compiler_of_torch() -> None:
    """Which takes longer than many a fit."""
    script = (
        "import sys\n"
        "from annik_core import load_robot\n"
        "from annik_training import generate_dataset\n"
        "from annik_training.fitting.fit import fit\n"
        "from annik_training.fitting.options import FitOptions\n"
        "dataset = generate_dataset(load_robot('gantry'), 'sobol', 20)\n"
        "for optimiser in ('levenberg_marquardt', 'lbfgs'):\n"
        "    options = {'optimiser': optimiser, 'sobolev_weight': 1.0, 'max_evaluations': 3}\n"
        "    fit(dataset, FitOptions(hidden_units=(3,), restarts=1, **options))\n"
        "print({'torch._dynamo', 'sympy'} & set(sys.modules))\n"
    )
    result = run_python("-c", script)
    assert result.stdout == "set()\n", result.stderr
