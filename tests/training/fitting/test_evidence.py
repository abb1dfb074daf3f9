"""The evidence of a weight decay, and the decay that it chooses. ROS-free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from annik_training.fitting.evidence import PATH, Evidence, evidence, minimise_with_chosen_decay
from annik_training.fitting.variable_projection import ScaledExamples, SeparableProblem, minimise
from annik_training.networks.network import HiddenLayers

pytestmark = pytest.mark.usefixtures("one_thread")

INPUTS, UNITS, DIRECTIONS, OUTPUTS = 2, 3, 2, 2
SLOPE_WEIGHT = 0.3

OPTIONS = pytest.mark.parametrize(
    ("linear_path", "sobolev_weight"), [(False, 0.0), (True, 0.0), (True, SLOPE_WEIGHT)]
)


@dataclass(frozen=True)
class Setting:
    """A problem of 3 tanh units, and what it was made of."""

    problem: SeparableProblem
    start: np.ndarray
    examples: ScaledExamples
    linear_path: bool
    sobolev_weight: float


def setting(linear_path: bool = False, sobolev_weight: float = 0.0, count: int = 14) -> Setting:
    rng = np.random.default_rng(3)
    inputs = rng.uniform(-1, 1, (count, INPUTS))
    targets = np.sin(2 * inputs + 1) @ [[1.0, 0.4], [-0.6, 1.0]]
    examples = ScaledExamples(
        torch.from_numpy(inputs),
        torch.from_numpy(targets + 0.1 * rng.normal(size=targets.shape)),
        torch.from_numpy(rng.uniform(-1, 1, (count, DIRECTIONS, INPUTS))),
        torch.from_numpy(rng.uniform(-1, 1, (count, DIRECTIONS, OUTPUTS))),
    )
    hidden = HiddenLayers(INPUTS, (UNITS,))
    hidden.initialise(rng)
    start = np.concatenate([p.detach().numpy().reshape(-1) for p in hidden.parameters()])
    problem = SeparableProblem(
        hidden,
        examples,
        0.1,
        linear_path=linear_path,
        sobolev_weight=sobolev_weight,
        decay_hidden=True,
    )
    return Setting(problem, start, examples, linear_path, sobolev_weight)


def errors_and_jacobian(case: Setting, hidden: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the whole network in all its weights ``(p,)``, in coordinates that Z has no part in.

    The output weights are the problem's own, which its own tests hold to NumPy's.
    """
    x, y = case.examples.inputs.numpy(), case.examples.targets.numpy()
    scale = np.sqrt(case.sobolev_weight)
    along = scale * case.examples.directions.numpy().reshape(-1, INPUTS)
    z = np.column_stack([x, np.ones(len(x))])
    if case.sobolev_weight > 0:
        z = np.concatenate([z, np.column_stack([along, np.zeros(len(along))])])
        y = np.concatenate([y, scale * case.examples.derivatives.numpy().reshape(-1, OUTPUTS)])
    apart_from_z = null_space((z if case.linear_path else z[:, -1:]).T)

    def errors(weights: np.ndarray) -> np.ndarray:
        first, bias, output = np.split(weights, [UNITS * INPUTS, UNITS * (INPUTS + 1)])
        first, output = first.reshape(UNITS, INPUTS), output.reshape(OUTPUTS, UNITS)
        activations = np.tanh(x @ first.T + bias)
        answers = activations @ output.T
        if case.sobolev_weight > 0:
            rates = np.repeat(1.0 - activations**2, DIRECTIONS, axis=0)
            answers = np.concatenate([answers, (rates * (along @ first.T)) @ output.T])
        return (apart_from_z.T @ (answers - y)).reshape(-1)

    weights = all_weights(case, hidden)
    step = 1e-6
    jacobian = [
        (errors(weights + move) - errors(weights - move)) / (2.0 * step)
        for move in step * np.eye(len(weights))
    ]
    return errors(weights), np.stack(jacobian, axis=1)


def all_weights(case: Setting, hidden: np.ndarray) -> np.ndarray:
    output = case.problem.linear_layers(hidden).output.numpy()
    return np.concatenate([hidden, output.reshape(-1)])


def evidence_at(case: Setting, decay: float, hidden: np.ndarray) -> Evidence:
    case.problem.ridge = decay
    return evidence(case.problem, hidden)


@OPTIONS
@pytest.mark.parametrize("count", [14, 4])
def test_evidence_is_what_the_documentation_says(
    linear_path: bool, sobolev_weight: float, count: int
) -> None:
    """With H from finite differences, its determinant and its inverse; also with few examples."""
    case = setting(linear_path, sobolev_weight, count)
    constants = []
    for decay in (0.03, 0.2, 1.0):
        found = evidence_at(case, decay, case.start)
        weights = all_weights(case, case.start)
        errors, jacobian = errors_and_jacobian(case, case.start)
        observations, count_of_weights = jacobian.shape
        hessian = jacobian.T @ jacobian + decay**2 * np.eye(count_of_weights)
        determined = count_of_weights - decay**2 * np.trace(np.linalg.inv(hessian))
        assert found.determined_weights == pytest.approx(determined, rel=1e-6)
        e_d, e_w = 0.5 * errors @ errors, 0.5 * weights @ weights
        if observations > determined + 1.0:
            re_estimate = np.sqrt(determined * e_d / ((observations - determined) * e_w))
            assert found.re_estimate == pytest.approx(re_estimate, rel=1e-6)
        constants.append(
            found.log_evidence
            + 0.5 * observations * np.log(2.0 * (e_d + decay**2 * e_w) / observations)
            - count_of_weights * np.log(decay)
            + 0.5 * np.linalg.slogdet(hessian)[1]
        )
    assert constants == pytest.approx([constants[0]] * 3, abs=1e-6)


@OPTIONS
def test_evidence_is_the_likelihood_of_the_examples(
    linear_path: bool, sobolev_weight: float
) -> None:
    """Of the network linearised at the minimum: a Gaussian of the examples, by SciPy's density."""
    case = setting(linear_path, sobolev_weight)
    differences = []
    weights = case.start
    for decay in (0.1, 0.2, 0.4):
        case.problem.ridge = decay
        weights, _ = minimise(case.problem, weights, 300)
        found = evidence(case.problem, weights)
        errors, jacobian = errors_and_jacobian(case, weights)
        everything = all_weights(case, weights)
        assert jacobian.T @ errors == pytest.approx(-(decay**2) * everything, abs=1e-5)
        # What the network is told, were it linear; weights of variance 1 / r^2, noise of 1.
        examples = jacobian @ everything - errors
        covariance = np.eye(len(examples)) + jacobian @ jacobian.T / decay**2
        noise = examples @ np.linalg.solve(covariance, examples) / len(examples)
        likelihood = multivariate_normal(cov=noise * covariance).logpdf(examples)
        differences.append(found.log_evidence - likelihood)
    assert differences == pytest.approx([differences[0]] * 3, abs=1e-4)


def line_and_noise(noise: float, seed: int) -> tuple[SeparableProblem, np.ndarray]:
    """An affine function to be learned by 8 tanh units."""
    rng = np.random.default_rng(seed)
    slope, shift = rng.uniform(-1, 1, (3, 2)) / 3.0, rng.uniform(-0.3, 0.3, 2)
    values = rng.uniform(-1, 1, (40, 3))
    targets = values @ slope + shift + noise * rng.normal(size=(40, 2))
    hidden = HiddenLayers(3, (8,))
    hidden.initialise(rng)
    start = np.concatenate([p.detach().numpy().reshape(-1) for p in hidden.parameters()])
    examples = ScaledExamples(torch.from_numpy(values), torch.from_numpy(targets))
    return SeparableProblem(hidden, examples, 1e-7, decay_hidden=True), start


def test_examples_without_noise_want_little_decay_and_noisy_ones_more() -> None:
    for seed in range(2):
        chosen = []
        for noise in (0.0, 0.01, 0.1):
            problem, start = line_and_noise(noise, seed)
            minimise_with_chosen_decay(problem, start, 50)
            chosen.append(problem.ridge)
        assert chosen[0] < 1e-5
        assert 1e-3 < chosen[1] < chosen[2]


def test_the_evidence_knows_how_much_noise_there_is() -> None:
    """2 E_D / (N - gamma) is its variance: within a quarter, of 80 numbers."""
    for seed in range(3):
        problem, start = line_and_noise(0.05, seed)
        weights, _ = minimise_with_chosen_decay(problem, start, 50)
        found = evidence(problem, weights)
        free = problem.observations - found.determined_weights
        assert np.sqrt(problem.squared_residual(weights) / free) == pytest.approx(0.05, rel=0.25)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_no_stop_of_the_path_has_clearly_more_evidence_than_what_is_chosen(noise: float) -> None:
    """Clearly: by a factor of e, as each is at a minimum nearby and not at the same one."""
    for seed in range(2):
        problem, start = line_and_noise(noise, seed)
        weights, _ = minimise_with_chosen_decay(problem, start, 50)
        chosen = evidence(problem, weights).log_evidence
        weights, found = start, []
        for decay in PATH:
            problem.ridge = decay
            weights, _ = minimise(problem, weights, 4)
            found.append(evidence(problem, weights).log_evidence)
        assert max(found) < chosen + 1.0
        assert min(found) < chosen - 10.0


@pytest.mark.parametrize("most", [1, 8, 9, 16, 17, 40])
def test_evaluations_are_bounded(most: int) -> None:
    """By what is allowed, but for one at each stop of the path."""
    problem, start = line_and_noise(0.01, seed=0)
    weights, evaluations = minimise_with_chosen_decay(problem, start, most)
    assert len(PATH) <= evaluations <= max(most, len(PATH))
    assert np.isfinite(weights).all()
    assert 1e-9 <= problem.ridge <= 1.0


@OPTIONS
def test_targets_that_are_all_zero_give_a_network_that_is_zero(
    linear_path: bool, sobolev_weight: float
) -> None:
    case = setting(linear_path, sobolev_weight)
    zero = ScaledExamples(
        case.examples.inputs,
        torch.zeros_like(case.examples.targets),
        case.examples.directions,
        torch.zeros_like(case.examples.derivatives),
    )
    hidden = HiddenLayers(INPUTS, (UNITS,))
    problem = SeparableProblem(
        hidden,
        zero,
        0.1,
        linear_path=linear_path,
        sobolev_weight=sobolev_weight,
        decay_hidden=True,
    )
    weights, _ = minimise_with_chosen_decay(problem, case.start, 20)
    assert np.isfinite(weights).all()
    assert np.isfinite(problem.ridge)
    assert problem.mean_square_error(weights) == 0.0
    assert np.isfinite(list(vars(evidence(problem, weights)).values())).all()
