"""How heavy the tails of drawn noise are found to be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from annik_training.calibration.noise_tails import noise_degrees
from annik_training.calibration.observations import NOISE_DEGREES


def squares(degrees: float | None, count: int, dimensions: int, seed: int) -> np.ndarray:
    """Of Student's distribution in so many dimensions, or of Gauss's."""
    draw = np.random.default_rng(seed)
    found = (draw.normal(size=(count, dimensions)) ** 2).sum(axis=1)
    return found if degrees is None else found * degrees / draw.chisquare(degrees, size=count)


@pytest.mark.parametrize("dimensions", [3, 6])
@pytest.mark.parametrize("seed", range(5))
def test_many_rows_tell_the_tails(dimensions: int, seed: int) -> None:
    assert noise_degrees(squares(4.0, 500, dimensions, seed), dimensions) < 6.0
    assert 6.0 < noise_degrees(squares(10.0, 500, dimensions, seed), dimensions) < 20.0
    assert noise_degrees(squares(None, 500, dimensions, seed), dimensions) > 50.0


@pytest.mark.parametrize("seed", range(5))
def test_few_rows_are_not_taken_for_proof(seed: int) -> None:
    assert NOISE_DEGREES < noise_degrees(squares(None, 8, 3, seed), 3) < 40.0


def test_rows_that_tell_the_same_are_no_proof() -> None:
    few = squares(None, 10, 3, 1)
    repeated = noise_degrees(few.repeat(8), 3, redundancy=8.0)
    assert repeated == pytest.approx(noise_degrees(few, 3), rel=1e-6)
    assert abs(noise_degrees(few.repeat(8), 3) / repeated - 1.0) > 0.2


@pytest.mark.parametrize("values", [(), (0.0,), (0.0, 0.0), (0.0, 0.0, 1e12)])
def test_without_noise_the_tails_are_heavy(values: tuple[float, ...]) -> None:
    assert noise_degrees(np.array(values), 3) == pytest.approx(NOISE_DEGREES, rel=1e-6)


@given(
    st.lists(st.floats(0.0, 1e12), min_size=1, max_size=40),
    st.sampled_from([3, 6]),
    st.floats(1e-9, 1e9),
)
def test_any_residuals_have_some_whatever_their_scale(
    values: list[float], dimensions: int, scale: float
) -> None:
    found = noise_degrees(np.array(values), dimensions)
    assert NOISE_DEGREES <= found <= 1000.0
    if np.median(values) * scale > 1e-9 and np.median(values) > 1e-9:
        assert noise_degrees(scale * np.array(values), dimensions) == pytest.approx(
            found, rel=1e-3
        )
