"""Averages of measured poses, which of them to believe, and their noise. ROS-free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from annik_core.collection.measurement import average_poses, measurement_fault, noise_of_averages
from annik_core.collection.settings import CollectionSettings
from annik_core.errors import InvalidValue
from annik_core.pose import pose_distance, pose_from_roll_pitch_yaw

POSE = pose_from_roll_pitch_yaw([0.4, -0.2, 0.9], [0.3, -1.1, 2.9])
SETTINGS = CollectionSettings()


def noisy(rng, count: int, position: float = 1e-4, orientation: float = 1e-3, pose=POSE):
    """Samples of a pose with Gaussian noise [m, rad]."""
    turns = Rotation.from_rotvec(rng.normal(0, orientation, (count, 3)))
    quaternions = (turns * Rotation.from_quat(pose[3:])).as_quat()
    # Either of a quaternion and its negative means the orientation.
    quaternions *= rng.choice([-1.0, 1.0], (count, 1))
    return np.hstack([pose[:3] + rng.normal(0, position, (count, 3)), quaternions])


def test_equal_samples_have_themselves_as_their_average() -> None:
    average = average_poses([POSE] * 7)
    assert pose_distance(POSE, average.pose) == pytest.approx((0, 0), abs=1e-12)
    assert average.samples == 7
    assert average.outlier is None
    assert measurement_fault(average, POSE, SETTINGS) is None


@given(st.integers(0, 1000), st.integers(1, 40))
def test_the_average_is_near_and_its_quaternion_is_a_unit_quaternion(seed, count) -> None:
    average = average_poses(noisy(np.random.default_rng(seed), count))
    assert np.linalg.norm(average.pose[3:]) == pytest.approx(1.0, abs=1e-12)
    assert average.pose[6] >= 0
    distance, angle = pose_distance(POSE, average.pose)
    assert distance < 1e-3
    assert angle < 1e-2


def test_one_sample_is_its_own_average() -> None:
    average = average_poses([POSE])
    assert pose_distance(POSE, average.pose) == pytest.approx((0, 0), abs=1e-12)
    assert measurement_fault(average, POSE, SETTINGS) is None


@pytest.mark.parametrize("offset", [[0.02, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0.1, 0]])
def test_a_single_outlier_is_found_by_position_or_orientation(offset) -> None:
    samples = noisy(np.random.default_rng(0), 10)
    turned = Rotation.from_rotvec(offset[3:]) * Rotation.from_quat(samples[4, 3:])
    samples[4] = [*(samples[4, :3] + offset[:3]), *turned.as_quat()]
    average = average_poses(samples)
    assert average.outlier == 4
    fault = measurement_fault(average, POSE, SETTINGS)
    assert fault is not None
    assert "sample 5 of 10 is far from the others" in fault


@pytest.mark.parametrize(("samples", "most"), [(5, 0.004), (10, 0.001), (20, 0.0005)])
def test_gaussian_noise_is_hardly_ever_taken_for_an_outlier(samples, most) -> None:
    rng = np.random.default_rng(1)
    found = sum(average_poses(noisy(rng, samples)).outlier is not None for _ in range(4000))
    assert found <= most * 4000


def test_rounding_is_no_outlier() -> None:
    samples = np.repeat(POSE[None], 10, axis=0)
    samples[3, 0] += 1e-5
    assert average_poses(samples).outlier is None


def test_samples_that_scatter_too_much_are_refused_with_numbers_and_limits() -> None:
    samples = noisy(np.random.default_rng(2), 10, position=0.01)
    fault = measurement_fault(average_poses(samples), POSE, SETTINGS)
    assert fault is not None
    assert fault.startswith("the samples differ from their mean by up to")
    assert fault.endswith("allowed are 5 mm and 0.05 rad")


@pytest.mark.parametrize("offset", [[0.06, 0, 0], [0, 0, -0.051]])
def test_a_mean_far_from_nominal_is_refused(offset) -> None:
    nominal = POSE.copy()
    nominal[:3] += offset
    fault = measurement_fault(average_poses([POSE] * 3), nominal, SETTINGS)
    assert fault is not None
    assert "the mean differs from the nominal forward kinematics by" in fault
    assert "allowed are 50 mm and 0.2 rad" in fault


def test_a_mean_turned_from_nominal_is_refused() -> None:
    turned = Rotation.from_rotvec([0.25, 0, 0]) * Rotation.from_quat(POSE[3:])
    fault = measurement_fault(
        average_poses([POSE] * 3), np.array([*POSE[:3], *turned.as_quat()]), SETTINGS
    )
    assert fault is not None
    assert "0.25 rad" in fault


def test_the_noise_of_the_averages_is_that_of_the_samples_by_the_root_of_their_number() -> None:
    rng = np.random.default_rng(3)
    averages = [average_poses(noisy(rng, 5, 2e-4, 3e-3)) for _ in range(2000)]
    noise = noise_of_averages([(x.samples, x.square_sums) for x in averages])
    assert noise == pytest.approx((2e-4 / math.sqrt(5), 3e-3 / math.sqrt(5)), rel=0.02)
    errors = np.array([x.pose[:3] - POSE[:3] for x in averages])
    assert noise is not None
    assert noise[0] == pytest.approx(errors.std(), rel=0.03)


def test_one_sample_of_each_pose_says_nothing_of_the_noise() -> None:
    assert noise_of_averages([(1, (0.0, 0.0))] * 5) is None
    assert noise_of_averages([]) is None


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("command_rate", 0.0),
        ("max_joint_velocity", math.inf),
        ("max_joint_velocity", math.nan),
        ("samples", 0),
        ("settle_time", -1.0),
        ("settle_timeout", 0.5),
        ("pose_timeout", math.nan),
        ("max_retries", -1),
    ],
)
def test_settings_that_make_no_sense_are_refused_by_name(setting, value) -> None:
    with pytest.raises(InvalidValue) as caught:
        CollectionSettings(**{setting: value})
    assert caught.value.name == setting
