"""Checks of measurements. ROS-free."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support.imperfect_ur5e import ImperfectUr5e, measured_ur5e

from annik_core.errors import NonFiniteValue
from annik_training.calibration.errors import InvalidMeasurements
from annik_training.calibration.measurements import KnownDistance, Measurements

JOINTS = np.zeros((4, 6))
POINTS = np.array([0, 0, 1, 1])
BROKEN = np.full((4, 3), np.nan)


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("joint_positions", {"joint_positions": np.zeros(6)}),
        ("positions", {}),
        ("positions", {"positions": np.zeros((3, 3))}),
        ("positions", {"positions": np.zeros((4, 3)), "fixed_points": POINTS}),
        ("rotations", {"rotations": np.zeros((4, 3, 3)), "positions": np.zeros((4, 3))}),
        ("rotations", {"rotations": np.tile(np.eye(3), (4, 1, 1)), "fixed_points": POINTS}),
        ("distances", {"positions": np.zeros((4, 3)), "distances": [KnownDistance(0, 1, 0.05)]}),
        ("distances", {"fixed_points": POINTS, "distances": [KnownDistance(0, 2, 0.05)]}),
        ("distances", {"fixed_points": POINTS, "distances": [KnownDistance(0, 1, -0.05)]}),
        ("sigma", {"positions": np.zeros((4, 3)), "sigma": (-1.0, 0.0)}),
        ("frame_known", {"fixed_points": POINTS, "frame_known": True}),
    ],
)
def test_what_does_not_fit_is_refused(name: str, arguments: dict[str, Any]) -> None:
    with pytest.raises(InvalidMeasurements) as caught:
        Measurements(**{"joint_positions": JOINTS, **arguments})
    assert caught.value.name == name


def test_what_is_no_number_is_named_by_its_row() -> None:
    with pytest.raises(NonFiniteValue) as caught:
        Measurements(JOINTS, positions=BROKEN)
    assert caught.value.field == "row 0 of the positions"


def test_of_a_dataset_frames_are_known() -> None:
    dataset = measured_ur5e(ImperfectUr5e.drawn(1), 8)
    measurements = Measurements.of(dataset)
    assert measurements.frame_known
    assert measurements.tool_known
    assert measurements.sigma == dataset.measurement_noise
    assert len(measurements.where(np.arange(8) < 3)) == 3


def test_rows_keep_the_distances_between_their_points() -> None:
    distances = [KnownDistance(0, 1, 0.05)]
    measurements = Measurements(JOINTS, fixed_points=POINTS, distances=distances)
    assert measurements.where(np.array([0, 3])).distances == distances
    assert measurements.where(np.array([0, 1])).distances == []
    assert measurements.content_hash != measurements.where(np.array([0, 3])).content_hash
