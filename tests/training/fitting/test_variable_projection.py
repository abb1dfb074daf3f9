"""The projected problem: exact gradients, linear layers that are the optimum. ROS-free.

What it is compared with is computed here in NumPy: the activations from the layers' weights, their
derivatives by complex steps, everything linear by NumPy's least squares. Numbers of examples,
inputs, directions, outputs and units all differ, so that nothing transposed fits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from torch.nn.utils import vector_to_parameters

from annik_training.fitting.variable_projection import ScaledExamples, SeparableProblem, minimise
from annik_training.networks.network import HiddenLayers, ScaledNetwork, Scaling

pytestmark = pytest.mark.usefixtures("one_thread")

EXAMPLES, INPUTS, DIRECTIONS, OUTPUTS = 9, 3, 2, 4
RIDGE = 0.1

UNITS = pytest.mark.parametrize("units", [(5,), (6, 5)])
OPTIONS = pytest.mark.parametrize(
    "options",
    [
        {},
        {"linear_path": True},
        {"sobolev_weight": 0.3},
        {"decay_hidden": True},
        {"linear_path": True, "sobolev_weight": 0.3, "decay_hidden": True},
    ],
    ids=lambda options: "+".join(options) or "plain",
)


def flat_weights(hidden: HiddenLayers) -> np.ndarray:
    return np.concatenate([p.detach().numpy().reshape(-1) for p in hidden.parameters()])


def some_examples(count: int = EXAMPLES, seed: int = 0) -> ScaledExamples:
    """Anything at all: the problem does not ask whether the derivatives go with the targets."""
    rng = np.random.default_rng(seed)

    def uniform(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.uniform(-1.0, 1.0, shape))

    return ScaledExamples(
        uniform(count, INPUTS),
        uniform(count, OUTPUTS),
        uniform(count, DIRECTIONS, INPUTS),
        uniform(count, DIRECTIONS, OUTPUTS),
    )


@dataclass(frozen=True)
class Setting:
    """A problem, and what it was made of."""

    problem: SeparableProblem
    hidden: HiddenLayers
    weights: np.ndarray
    examples: ScaledExamples
    linear_path: bool
    sobolev_weight: float
    decay_hidden: bool


def setting(
    units: tuple[int, ...],
    examples: ScaledExamples | None = None,
    *,
    linear_path: bool = False,
    sobolev_weight: float = 0.0,
    decay_hidden: bool = False,
) -> Setting:
    hidden = HiddenLayers(INPUTS, units)
    hidden.initialise(np.random.default_rng(1))
    examples = examples or some_examples()
    weights = flat_weights(hidden)
    problem = SeparableProblem(
        hidden,
        examples,
        RIDGE,
        linear_path=linear_path,
        sobolev_weight=sobolev_weight,
        decay_hidden=decay_hidden,
    )
    return Setting(problem, hidden, weights, examples, linear_path, sobolev_weight, decay_hidden)


def activations(hidden: HiddenLayers, weights: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Of the last hidden layer, also for complex inputs."""
    vector_to_parameters(torch.from_numpy(weights), hidden.parameters())
    for layer in hidden.layers:
        inputs = np.tanh(inputs @ layer.weight.detach().numpy().T + layer.bias.detach().numpy())
    return inputs


def rows(case: Setting, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """S, Z and Y: a row for the value of each example, and one for each of its derivatives."""
    inputs, targets = case.examples.inputs.numpy(), case.examples.targets.numpy()
    s = [activations(case.hidden, weights, inputs)]
    z = [np.column_stack([inputs, np.ones(len(inputs))])]
    y = [targets]
    if case.sobolev_weight > 0:
        scale = np.sqrt(case.sobolev_weight)
        for direction in range(DIRECTIONS):
            along = case.examples.directions[:, direction].numpy()
            step = 1e-30
            shifted = activations(case.hidden, weights, inputs + 1j * step * along)
            s.append(scale * shifted.imag / step)
            z.append(scale * np.column_stack([along, np.zeros(len(inputs))]))
            y.append(scale * case.examples.derivatives[:, direction].numpy())
    stacked = np.concatenate(z)
    if not case.linear_path:
        stacked = stacked[:, -1:]
    return np.concatenate(s), stacked, np.concatenate(y)


def best_linear_layers(case: Setting) -> tuple[np.ndarray, np.ndarray]:
    """W^T and V^T by least squares over [S Z], with a ridge below S only."""
    s, z, y = rows(case, case.weights)
    ridge = np.hstack([RIDGE * np.eye(s.shape[1]), np.zeros((s.shape[1], z.shape[1]))])
    matrix = np.vstack([np.hstack([s, z]), ridge])
    right = np.vstack([y, np.zeros((s.shape[1], OUTPUTS))])
    solution = np.linalg.lstsq(matrix, right, rcond=1e-12)[0]
    return solution[: s.shape[1]], solution[s.shape[1] :]


def central_differences(
    function: Callable[[np.ndarray], np.ndarray | float], at: np.ndarray, step: float = 1e-5
) -> np.ndarray:
    """Derivatives, one column per number in ``at``."""
    return np.stack(
        [
            (np.asarray(function(at + move)) - np.asarray(function(at - move))) / (2.0 * step)
            for move in step * np.eye(len(at))
        ],
        axis=-1,
    )


@UNITS
@OPTIONS
def test_gradient_of_the_sum_of_squares_is_exact(
    units: tuple[int, ...], options: dict[str, float]
) -> None:
    """Kaufman's Jacobian drops only what is orthogonal to the residual."""
    case = setting(units, **options)
    residual = case.problem.residual(case.weights)
    gradient = case.problem.jacobian(case.weights).T @ residual
    numerical = central_differences(
        lambda weights: 0.5 * np.sum(case.problem.residual(weights) ** 2), case.weights
    )
    assert np.abs(gradient).max() > 1e-2
    assert gradient == pytest.approx(numerical, rel=1e-6, abs=1e-9)


@UNITS
@OPTIONS
def test_the_jacobian_is_kaufmans(units: tuple[int, ...], options: dict[str, float]) -> None:
    """-(I - A A^+) (dA/dp) W^T; compared by J^T J, which the order of the rows does not change."""
    case = setting(units, **options)

    def projected(weights: np.ndarray) -> np.ndarray:
        s, z, _ = rows(case, weights)
        ridge = RIDGE * np.eye(s.shape[1])
        return np.vstack([s - z @ np.linalg.lstsq(z, s, rcond=None)[0], ridge])

    a = projected(case.weights)
    output, _ = best_linear_layers(case)
    derivative = central_differences(projected, case.weights)
    moved = np.einsum("nhp,hk->nkp", derivative, output).reshape(len(a), -1)
    expected = (moved - a @ np.linalg.pinv(a) @ moved).reshape(-1, len(case.weights))
    squared = expected.T @ expected
    if case.decay_hidden:
        squared += RIDGE**2 * np.eye(len(case.weights))
    jacobian = case.problem.jacobian(case.weights)
    assert jacobian.shape == (len(case.problem.residual(case.weights)), len(case.weights))
    assert jacobian.T @ jacobian == pytest.approx(squared, rel=1e-6, abs=1e-9)


@UNITS
@OPTIONS
def test_the_derivatives_by_the_hidden_weights_are_those_of_torch(
    units: tuple[int, ...], options: dict[str, float]
) -> None:
    """Of the activations, and of their derivatives along each direction."""
    case = setting(units, **options)
    along = np.sqrt(case.sobolev_weight) * case.examples.directions
    shapes = {name: value.shape for name, value in case.hidden.named_parameters()}

    def stacked(flat: torch.Tensor) -> torch.Tensor:
        parts = torch.split(flat, [shape.numel() for shape in shapes.values()])
        named = {
            name: part.reshape(shapes[name]) for name, part in zip(shapes, parts, strict=True)
        }

        def phi(inputs: torch.Tensor) -> torch.Tensor:
            return torch.func.functional_call(case.hidden, named, (inputs,))

        values = phi(case.examples.inputs)
        if case.sobolev_weight == 0:
            return values
        gradients = torch.func.vmap(torch.func.jacrev(phi))(case.examples.inputs)
        moved = torch.einsum("nhm,ndm->ndh", gradients, along)
        return torch.cat([values, moved.flatten(end_dim=1)])

    found = torch.func.jacrev(stacked)(torch.from_numpy(case.weights)).detach().numpy()
    output = np.random.default_rng(3).normal(size=(units[-1], OUTPUTS))
    expected = np.einsum("nhp,hk->nkp", found, output)
    z = np.zeros((len(expected), INPUTS + 1))
    z[:EXAMPLES] = np.column_stack([case.examples.inputs, np.ones(EXAMPLES)])
    z[EXAMPLES:, :INPUTS] = along.flatten(end_dim=1)[: len(z) - EXAMPLES]
    z = z if case.linear_path else z[:, -1:]
    expected -= np.tensordot(z @ np.linalg.pinv(z), expected, axes=1)
    jacobian = case.problem.activations_jacobian(case.weights, torch.from_numpy(output))
    assert jacobian.numpy() == pytest.approx(expected, rel=0, abs=1e-13)


@UNITS
@OPTIONS
def test_the_linear_layers_are_the_least_squares_solution(
    units: tuple[int, ...], options: dict[str, float]
) -> None:
    """No others leave a smaller residual: against NumPy's solver."""
    case = setting(units, **options)
    layers = case.problem.linear_layers(case.weights)
    output, rest = best_linear_layers(case)
    assert layers.output.numpy() == pytest.approx(output.T)
    assert layers.bias.numpy() == pytest.approx(rest[-1])
    path = rest[:-1].T if case.linear_path else np.zeros((OUTPUTS, INPUTS))
    assert layers.linear_path.numpy() == pytest.approx(path)


def three_examples() -> ScaledExamples:
    return some_examples(3)


def examples_of_two_free_inputs() -> ScaledExamples:
    examples = some_examples()
    inputs, directions = examples.inputs.clone(), examples.directions.clone()
    inputs[:, 2] = inputs[:, 0] - 2.0 * inputs[:, 1]
    directions[:, :, 2] = directions[:, :, 0] - 2.0 * directions[:, :, 1]
    return replace(examples, inputs=inputs, directions=directions)


def one_example_nine_times() -> ScaledExamples:
    return some_examples().rows(np.zeros(EXAMPLES, dtype=np.int64))


@pytest.mark.parametrize("sobolev_weight", [0.0, 0.3])
@pytest.mark.parametrize(
    "examples", [three_examples, examples_of_two_free_inputs, one_example_nine_times]
)
def test_of_many_best_linear_paths_it_is_the_least(
    examples: Callable[[], ScaledExamples], sobolev_weight: float
) -> None:
    """Which is what NumPy's solver gives where the examples leave the choice."""
    case = setting((5,), examples(), linear_path=True, sobolev_weight=sobolev_weight)
    layers = case.problem.linear_layers(case.weights)
    output, rest = best_linear_layers(case)
    assert layers.output.numpy() == pytest.approx(output.T, abs=1e-12)
    assert layers.linear_path.numpy() == pytest.approx(rest[:-1].T)
    assert layers.bias.numpy() == pytest.approx(rest[-1])
    assert np.isfinite(case.problem.residual(case.weights)).all()
    assert np.isfinite(case.problem.jacobian(case.weights)).all()


@UNITS
@OPTIONS
def test_the_residual_is_that_of_the_network_with_these_layers(
    units: tuple[int, ...], options: dict[str, float]
) -> None:
    """Values, derivatives by finite differences of the network, ridge, decay: each once."""
    case = setting(units, **options)
    layers = case.problem.linear_layers(case.weights)
    box = Scaling(-np.ones(INPUTS), np.ones(INPUTS))
    network = ScaledNetwork(
        units, box, Scaling(-np.ones(OUTPUTS), np.ones(OUTPUTS)), linear_path=case.linear_path
    )
    vector_to_parameters(torch.from_numpy(case.weights), network.hidden.parameters())
    with torch.no_grad():
        network.output.weight.copy_(layers.output)
        network.output.bias.copy_(layers.bias)
        if network.linear_path is not None:
            network.linear_path.weight.copy_(layers.linear_path)

    inputs = case.examples.inputs.numpy()
    values = network.predict(inputs) - case.examples.targets.numpy()
    derivatives = np.zeros(0)
    if case.sobolev_weight > 0:
        step = 1e-5 * case.examples.directions.numpy()
        found = [
            (network.predict(inputs + step[:, d]) - network.predict(inputs - step[:, d])) / 2e-5
            for d in range(DIRECTIONS)
        ]
        derivatives = np.stack(found, axis=1) - case.examples.derivatives.numpy()
    weighted = np.sqrt(case.sobolev_weight) * derivatives.reshape(-1)
    ridge = RIDGE * layers.output.numpy().reshape(-1)
    decay = RIDGE * case.weights if case.decay_hidden else np.zeros(0)

    expected = np.concatenate([values.reshape(-1), weighted, ridge, decay])
    residual = case.problem.residual(case.weights)
    assert np.sort(np.abs(residual)) == pytest.approx(np.sort(np.abs(expected)), abs=1e-8)
    assert case.problem.mean_square_error(case.weights) == pytest.approx(np.mean(values**2))
    assert case.problem.squared_residual(case.weights) == pytest.approx(
        np.sum(values**2) + np.sum(weighted**2)
    )


@OPTIONS
def test_observations_are_those_that_the_linear_path_does_not_take_up(
    options: dict[str, float],
) -> None:
    case = setting((5,), **options)
    _, z, y = rows(case, case.weights)
    assert case.problem.outputs == OUTPUTS
    assert case.problem.observations == y.size - np.linalg.matrix_rank(z) * OUTPUTS


def test_derivatives_without_weight_change_nothing() -> None:
    examples = some_examples()
    case = setting((5,), examples, sobolev_weight=0.0)
    without = setting(
        (5,), replace(examples, directions=None, derivatives=None), sobolev_weight=1.0
    )
    assert np.array_equal(
        case.problem.residual(case.weights), without.problem.residual(case.weights)
    )


def test_some_rows_of_the_examples_with_their_derivatives() -> None:
    examples = some_examples()
    some = examples.rows(np.array([7, 2]))
    for name in ("inputs", "targets", "directions", "derivatives"):
        whole = getattr(examples, name)
        assert torch.equal(getattr(some, name), torch.stack([whole[7], whole[2]]))
    plain = replace(examples, directions=None, derivatives=None).rows(np.array([1]))
    assert plain.directions is None
    assert plain.derivatives is None


@UNITS
def test_assigned_weights_are_those_of_the_residual(units: tuple[int, ...]) -> None:
    case = setting(units)
    other = np.random.default_rng(2).normal(size=case.weights.shape)
    case.problem.assign(other)
    assigned = case.hidden(case.examples.inputs).detach().numpy()
    assert assigned == pytest.approx(
        activations(case.hidden, other, case.examples.inputs.numpy()), abs=1e-15
    )


def test_minimising_lowers_the_error_by_decades() -> None:
    rng = np.random.default_rng(0)
    inputs = torch.from_numpy(rng.uniform(-1, 1, (60, 2)))
    hidden = HiddenLayers(2, (10,))
    hidden.initialise(rng)
    start = flat_weights(hidden)
    problem = SeparableProblem(hidden, ScaledExamples(inputs, torch.sin(2 * inputs)), 1e-7)
    weights, _ = minimise(problem, start, max_evaluations=60)
    end = problem.mean_square_error(weights)
    assert end < 1e-3 * problem.mean_square_error(start)


def eight_examples(units: int, ridge: float) -> tuple[SeparableProblem, np.ndarray]:
    """Of six inputs and one output; with 40 units there are more weights than residuals."""
    rng = np.random.default_rng(0)
    inputs = torch.from_numpy(rng.uniform(-1, 1, (8, 6)))
    hidden = HiddenLayers(6, (units,))
    hidden.initialise(rng)
    problem = SeparableProblem(hidden, ScaledExamples(inputs, inputs[:, :1] ** 2), ridge)
    return problem, flat_weights(hidden)


def test_more_weights_than_residuals_still_fit() -> None:
    """MINPACK refuses that; the fit does not."""
    problem, start = eight_examples(units=40, ridge=1e-6)
    weights, _ = minimise(problem, start, max_evaluations=20)
    assert problem.mean_square_error(weights) < 1e-6


@pytest.mark.parametrize("units", [1, 40])
@pytest.mark.parametrize("most", [1, 2, 7])
def test_no_more_evaluations_than_allowed(units: int, most: int) -> None:
    problem, start = eight_examples(units, ridge=1e-2)
    weights, evaluations = minimise(problem, start, most)
    assert 1 <= evaluations <= most
    assert np.sum(problem.residual(weights) ** 2) <= np.sum(problem.residual(start) ** 2)
