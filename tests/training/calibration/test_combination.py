"""The weighted mean of several fits. ROS-free."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import minimize
from support.imperfect_ur5e import NOISE, ImperfectUr5e, measured_ur5e

from annik_core.robots.library import load_robot
from annik_training.calibration.calibrate import CalibrationOptions, calibrate
from annik_training.calibration.combination import (
    MeanEstimate,
    _chosen,
    _least_squares,
    combined,
)
from annik_training.calibration.estimation import Estimate, tuned
from annik_training.calibration.model import ParametricModel, Part
from annik_training.calibration.observations import Noise, Observations

UR5E = load_robot("ur5e")
RIGID = frozenset({Part.GEOMETRY})
ALIGNED = RIGID | {Part.ALIGNMENT}
BENDING = ALIGNED | {Part.DEFLECTION}
GEARS = RIGID | {Part.JOINT_SERIES}
ALL = BENDING | GEARS
FLEXIBLE = RIGID | {Part.POSE_SERIES}
TRUTH = ImperfectUr5e.drawn(1)
NOWHERE = UR5E.joint_box.sample(50, np.random.default_rng(8))


@lru_cache
def fitted(parts: frozenset[Part], redundancy: float = 1.0, rows: int = 40) -> Estimate:
    observations = Observations.of(measured_ur5e(replace(TRUTH, sag=6e-4), rows))
    model = ParametricModel(UR5E, parts)
    start = np.zeros(model.size)
    return tuned(model, replace(observations, redundancy=redundancy), Noise(1e-3, 1e-3), start)


def positions(found: Estimate) -> np.ndarray:
    return found.model.positions_and_rotations(found.model_parameters, NOWHERE)[0]


@pytest.mark.parametrize(
    ("scores", "chosen"),
    [((1.5, 1.05, 1.0), 1), ((1.5, 1.2, 1.0), 2), ((1.125, 1.0, 1.2), 0), ((1.0, 1.0), 0)],
)
def test_of_networks_the_simplest_within_a_standard_error_of_the_best_is_chosen(
    scores: tuple[float, ...], chosen: int
) -> None:
    assert _chosen(np.array(scores), [0.125] * len(scores)) == chosen


@pytest.mark.parametrize("seed", range(5))
def test_weights_are_those_of_least_squares(seed: int) -> None:
    """Against a general minimiser."""
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(60, 4)) @ rng.normal(size=(4, 4)) + rng.normal(size=(60, 1))
    found = _least_squares(columns)
    assert found.min() >= 0.0
    assert found.sum() == pytest.approx(1.0, abs=1e-12)
    best = minimize(
        lambda shares: float(((columns @ shares) ** 2).sum()),
        np.full(4, 0.25),
        bounds=[(0.0, 1.0)] * 4,
        constraints={"type": "eq", "fun": lambda shares: shares.sum() - 1.0},
    )
    # Small weights are left out.
    assert float(((columns @ found) ** 2).sum()) <= 1.02 * best.fun


@pytest.mark.parametrize("parts", [RIGID, ALIGNED, BENDING, GEARS, FLEXIBLE])
def test_parameters_have_their_places_in_a_model_with_more_parts(parts: frozenset[Part]) -> None:
    own, whole = ParametricModel(UR5E, parts), ParametricModel(UR5E, ALL | FLEXIBLE)
    places = own.indices_in(whole)
    assert [whole.names[place] for place in places] == list(own.names)
    parameters = np.random.default_rng(0).normal(size=own.size)
    scattered = np.zeros(whole.size)
    scattered[places] = parameters
    for one, same in zip(
        own.positions_and_rotations(parameters, NOWHERE),
        whole.positions_and_rotations(scattered, NOWHERE),
        strict=True,
    ):
        assert np.abs(one - same).max() < 1e-12


def test_the_mean_is_where_its_members_are_on_average() -> None:
    members = [fitted(RIGID), fitted(BENDING, 4.0), fitted(GEARS)]
    shares = np.array([0.2, 0.5, 0.3])
    mean = MeanEstimate.of(members, shares)
    assert mean.model.parts == ALL
    expected = sum(
        share * positions(one) for share, one in zip(shares.tolist(), members, strict=True)
    )
    apart = max(float(np.abs(positions(one) - expected).max()) for one in members)
    assert np.abs(positions(mean) - expected).max() < 0.02 * apart
    held_out = sum(
        share * one.noise.position * one.held_out_residuals[:, :3]
        for share, one in zip(shares.tolist(), members, strict=True)
    )
    assert np.allclose(mean.noise.position * mean.held_out_residuals[:, :3], held_out, rtol=1e-9)
    assert 1.0 < mean.observations.redundancy < 4.0


def test_the_fit_with_what_the_arm_has_gets_nearly_all_weight() -> None:
    found, candidates = combined([fitted(RIGID), fitted(BENDING), fitted(GEARS), fitted(ALL)])
    assert sum(one.weight for one in candidates) == pytest.approx(1.0)
    assert candidates[3].weight > 0.9
    assert candidates[3].score == min(one.score for one in candidates)
    assert np.abs(positions(found) - positions(fitted(ALL))).max() < 1e-4


def test_rows_that_count_as_one_move_the_arm_less_and_tell_less() -> None:
    """A quarter of the rows' information."""
    whole, quarter = fitted(RIGID), fitted(RIGID, 4.0)
    sizes = [float((one.model_parameters**2).sum()) for one in (whole, quarter)]
    assert sizes[1] < sizes[0]
    deviations = [np.sqrt(np.diag(one.covariance)) for one in (whole, quarter)]
    assert (deviations[1] > deviations[0]).mean() > 0.9


def test_leave_one_out_residuals_of_rows_that_count_as_one() -> None:
    """Their variance is as expected: that of chi square, about."""
    rigid = replace(TRUTH, amplitudes=np.zeros(6))
    observations = replace(Observations.of(measured_ur5e(rigid, 60)), redundancy=4.0)
    model = ParametricModel(UR5E, RIGID)
    found = tuned(model, observations, Noise(1e-3, 1e-3), np.zeros(model.size))
    scale = found.noise.position / found.residual_noise.position
    assert np.median(found.surprise) * scale**2 == pytest.approx(5.35, rel=0.4)


def test_the_noise_of_a_mean_is_that_of_its_rows() -> None:
    """However many of them count as one."""
    rigid = replace(TRUTH, amplitudes=np.zeros(6))
    observations = Observations.of(measured_ur5e(rigid, 60))
    model = ParametricModel(UR5E, RIGID)
    members = [
        tuned(
            model,
            replace(observations, redundancy=redundancy),
            Noise(1e-3, 1e-3),
            np.zeros(model.size),
        )
        for redundancy in (1.0, 8.0)
    ]
    mean = MeanEstimate.of(members, np.array([0.5, 0.5]))
    assert mean.noise.position == pytest.approx(NOISE[0], rel=0.2)
    assert mean.noise.orientation == pytest.approx(NOISE[1], rel=0.2)


def test_of_networks_one_fit_is_chosen() -> None:
    networks = RIGID | {Part.JOINT_NETWORKS}
    options = CalibrationOptions(candidates=(RIGID, networks), restarts=1, max_evaluations=20)
    found = calibrate(UR5E, measured_ur5e(TRUTH, 40), options)
    assert sorted(one.weight for one in found.candidates) == [0.0, 1.0]
    assert found.estimate.model.parts == networks
