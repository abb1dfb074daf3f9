"""Play, by approaches of the same place from both sides. ROS-free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.imperfect_ur5e import NOISE, ImperfectUr5e, measured

from annik_core.robots.library import load_robot
from annik_training.calibration.calibrate import CalibratedRobot, CalibrationOptions, calibrate
from annik_training.calibration.model import Part
from annik_training.calibration.observations import Noise
from annik_training.calibration.repeatability import repeatability
from annik_training.designs.registry import make_design

UR5E = load_robot("ur5e")
#: Without errors of the gears, so that the simplest model explains it.
TRUTH = replace(ImperfectUr5e.drawn(1), amplitudes=np.zeros(6))
QUICK = CalibrationOptions(candidates=(frozenset({Part.GEOMETRY}),))
#: Turns of the shoulder and the elbow by play [rad].
PLAY = np.array([0.0, 1e-3, 1e-3, 0.0, 0.0, 0.0])


def calibrated(play: np.ndarray) -> CalibratedRobot:
    """From three approaches of each of 30 places, from one side or the other at random."""
    places = np.repeat(make_design(UR5E, "sobol", 30, 0), 3, axis=0)
    sides = np.random.default_rng(0).choice([-1.0, 1.0], size=places.shape)

    def truth(joint_positions: np.ndarray) -> np.ndarray:
        return TRUTH.poses(joint_positions + play * sides)

    return calibrate(UR5E, measured(UR5E, truth, places), QUICK)


@pytest.fixture(scope="module")
def with_play() -> CalibratedRobot:
    return calibrated(PLAY)


@pytest.fixture(scope="module")
def without() -> CalibratedRobot:
    return calibrated(0.0 * PLAY)


def test_play_is_found_with_its_size(with_play: CalibratedRobot) -> None:
    places = UR5E.joint_box.sample(200, np.random.default_rng(1))
    sides = np.random.default_rng(2).choice([-1.0, 1.0], size=places.shape)
    apart = TRUTH.matrices(places + PLAY * sides)[:, :3, 3] - TRUTH.matrices(places)[:, :3, 3]
    found = with_play.repeatability
    assert found is not None
    assert found.is_play
    assert found.distance == pytest.approx(np.sqrt((apart**2).sum(axis=1).mean()), rel=0.3)
    assert with_play.provenance["play"] == found.distance


def test_without_play_there_is_the_noise(without: CalibratedRobot) -> None:
    found = without.repeatability
    assert found is not None
    assert not found.is_play
    assert found.distance == pytest.approx(np.sqrt(3.0) * NOISE[0], rel=0.3)
    assert without.provenance["play"] == 0.0


def test_play_widens_the_bound(with_play: CalibratedRobot, without: CalibratedRobot) -> None:
    wide, narrow = (one.robot.error_bound.at(np.zeros(6))[0] for one in (with_play, without))
    assert with_play.repeatability is not None
    assert wide > with_play.repeatability.distance
    assert wide > 5.0 * narrow


def test_single_approaches_tell_nothing(with_play: CalibratedRobot) -> None:
    found = with_play.estimate
    single = found.observations.where(np.arange(len(found.observations)) % 3 == 0)
    assert repeatability(replace(found, observations=single), Noise(*NOISE)) is None
