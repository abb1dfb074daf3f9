"""Calibration with measured poses, against an oracle that shares nothing with it. ROS-free.

The truth is :mod:`imperfect_ur5e`, so what comes out is compared with the robot itself, not with
measurements of it.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.imperfect_ur5e import (
    NOISE,
    PERFECT,
    ImperfectUr5e,
    distances,
    measured,
    measured_ur5e,
    with_poses,
)

from annik_core.dataset import Dataset
from annik_core.errors import AnnikError, InvalidValue, NonFiniteValue, RobotMismatch
from annik_core.pose import pose_distance
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.calibration import errors
from annik_training.calibration.calibrate import (
    CalibratedRobot,
    CalibrationOptions,
    calibrate,
    credible_noise,
)
from annik_training.calibration.errors import (
    DegenerateExamples,
    ImplausibleErrors,
    NotCalibrated,
    NotHeldOut,
    NotMeasured,
    TooFewMeasurements,
    UnexplainedMeasurements,
)
from annik_training.calibration.model import Part
from annik_training.calibration.observations import Noise
from annik_training.calibration.uncertainty import error_bound_of
from annik_training.calibration.validation import REGIONS, evaluate_measured
from annik_training.cli.calibrate import calibration_summary
from annik_training.cli.calibration_report import warnings
from annik_training.cli.evaluate import evaluation_summary
from annik_training.cli.plots import before_and_after
from annik_training.designs.registry import make_design
from annik_training.errors import UnsupportedRobot

TRUTH = ImperfectUr5e.drawn(1)
UR5E = load_robot("ur5e")
#: The simplest model, and what the truth needs.
RIGID_AND_GEARS = (
    frozenset({Part.GEOMETRY}),
    frozenset({Part.GEOMETRY, Part.JOINT_SERIES}),
)


#: Two models to choose from, one restart, and few evaluations.
QUICK = CalibrationOptions(candidates=RIGID_AND_GEARS, restarts=1, max_evaluations=40)


@pytest.fixture(scope="module")
def learned() -> CalibratedRobot:
    """From as many examples as the paper has, with the default options."""
    return calibrate(UR5E, measured_ur5e(TRUTH, 102))


@pytest.fixture(scope="module")
def held_out() -> Dataset:
    joint_positions = UR5E.joint_box.sample(400, np.random.default_rng(50))
    return measured(UR5E, TRUTH.poses, joint_positions, seed=9)


@pytest.fixture(scope="module")
def from_fifty() -> CalibratedRobot:
    return calibrate(UR5E, measured_ur5e(TRUTH, 50), QUICK)


@pytest.mark.slow
class TestAccuracy:
    """Distance of the calibrated robot from the true one, anywhere in the joint box."""

    def test_the_oracle_is_the_nominal_robot_where_nothing_is_wrong(self) -> None:
        assert distances(UR5E, PERFECT.poses, 100).max() < 1e-12
        joint_positions = UR5E.joint_box.sample(20, np.random.default_rng(0))
        poses = UR5E.forward_kinematics.poses(joint_positions)
        assert pose_distance(poses, PERFECT.poses(joint_positions))[1].max() < 1e-12
        assert distances(UR5E, TRUTH.poses, 100).mean() > 2e-3

    def test_of_102_examples(self, learned: CalibratedRobot) -> None:
        away = distances(learned.robot, TRUTH.poses, 2000)
        assert away.mean() <= 2e-5
        assert away.max() <= 1e-4
        assert learned.estimate.model.parts == {Part.GEOMETRY, Part.JOINT_SERIES}
        assert not learned.outliers.any()

    def test_of_50_examples(self, from_fifty: CalibratedRobot) -> None:
        away = distances(from_fifty.robot, TRUTH.poses, 2000)
        assert away.mean() <= 3e-5
        assert away.max() <= 1.5e-4

    def test_of_positions_alone(self) -> None:
        """Whatever the quaternions say."""
        dataset = measured_ur5e(TRUTH, 50)
        poses = dataset.poses.copy()
        poses[:, 3:] = [0.0, 0.0, 0.0, 1.0]
        found = calibrate(UR5E, with_poses(dataset, poses), replace(QUICK, position_only=True))
        away = distances(found.robot, TRUTH.poses, 1000)
        assert away.mean() <= 4e-5
        assert found.provenance["position_only"] is True
        assert "wrist_3_joint: zero" in found.unidentified

    def test_of_a_robot_that_is_as_described(self) -> None:
        found = calibrate(UR5E, measured_ur5e(PERFECT, 40), QUICK)
        assert found.estimate.model.parts == {Part.GEOMETRY}
        assert distances(found.robot, PERFECT.poses, 500).mean() <= 2e-5
        assert np.abs(found.estimate.parameters).max() < 0.3

    @pytest.mark.parametrize("stated", [(0.0, 0.0), None])
    def test_of_exact_measurements_of_it(self, stated: tuple[float, float] | None) -> None:
        """Where nothing is left, rounding is no outlier."""
        found = calibrate(UR5E, measured_ur5e(PERFECT, 30, noise=(0.0, 0.0), stated=stated), QUICK)
        assert not found.outliers.any()
        assert distances(found.robot, PERFECT.poses, 500).max() <= 1e-9
        assert all(0.0 < bound < 1e-5 for bound in found.robot.error_bound.at(np.zeros(6)))

    def test_of_exact_measurements_of_an_imperfect_one(self) -> None:
        """What its networks can't say is no outlier, or next to none is."""
        found = calibrate(
            UR5E, measured_ur5e(TRUTH, 30, noise=(0.0, 0.0), stated=(0.0, 0.0)), QUICK
        )
        assert found.outliers.sum() <= 1
        assert distances(found.robot, TRUTH.poses, 500).mean() <= 5e-6

    def test_the_noise_need_not_be_known(self) -> None:
        found = calibrate(UR5E, measured_ur5e(TRUTH, 30, stated=None), QUICK)
        assert distances(found.robot, TRUTH.poses, 1000).mean() <= 4e-5
        noise = found.estimate.noise
        assert (noise.position, noise.orientation) == pytest.approx(NOISE, rel=0.3)

    @pytest.mark.slow
    def test_a_deflection_is_found(self) -> None:
        """The arm's weight turns its shoulder: no joint's correction is a function of itself."""
        truth = replace(TRUTH, sag=6e-4)
        moved = np.linalg.norm(
            truth.matrices(learned_box(200))[:, :3, 3]
            - TRUTH.matrices(learned_box(200))[:, :3, 3],
            axis=1,
        )
        assert moved.mean() == pytest.approx(3e-4, rel=0.2)
        found = calibrate(UR5E, measured_ur5e(truth, 102))
        assert Part.DEFLECTION in found.estimate.model.parts
        assert distances(found.robot, truth.poses, 1000).mean() <= 2e-5


def learned_box(count: int) -> np.ndarray:
    return UR5E.joint_box.sample(count, np.random.default_rng(4))


class TestWhatIsSaid:
    """What else is known of a calibrated robot."""

    def test_the_same_seed_gives_the_same_bits(self, from_fifty: CalibratedRobot) -> None:
        again = calibrate(UR5E, measured_ur5e(TRUTH, 50), QUICK)
        assert np.array_equal(again.estimate.parameters, from_fifty.estimate.parameters)
        assert again.robot.definition_hash == from_fifty.robot.definition_hash

    def test_the_definition_carries_it(self, learned: CalibratedRobot) -> None:
        robot = robot_from_definition(learned.robot.definition, "again")
        assert robot.definition_hash == learned.robot.definition_hash
        provenance = robot.definition["corrections"]["provenance"]
        assert provenance["examples"] == 102
        assert provenance["parts"] == ["geometry", "joint series"]
        assert provenance["dataset_hash"] == learned.dataset.content_hash
        assert provenance["outliers"] == []

    def test_of_parallel_axes_the_offsets_stay_unknown(self, learned: CalibratedRobot) -> None:
        """But for one, which their sum tells: all three share it."""
        assert learned.unidentified == tuple(
            f"{joint}: offset along the axis"
            for joint in ("shoulder_lift_joint", "elbow_joint", "wrist_1_joint")
        )

    def test_candidates_are_judged_by_what_they_did_not_see(
        self, learned: CalibratedRobot
    ) -> None:
        numbers = [(one.parameters, one.redundancy) for one in learned.candidates]
        assert numbers[:6] == [(26, 1), (35, 1), (56, 1), (410, 1), (419, 1), (440, 1)]
        assert numbers[6] == (56 + 12 * 42, 1)
        assert numbers[7:] == [(size, factor) for size in (26, 35, 56) for factor in (2, 4, 8)]
        rigid, _, _, gears, *_ = learned.candidates
        assert sum(one.weight for one in learned.candidates) == pytest.approx(1.0)
        assert gears.weight == 1.0
        assert gears.score == pytest.approx(1.1, abs=0.2)
        assert rigid.score > 100.0 * gears.score
        summary = calibration_summary(learned)
        assert summary["candidates"][3]["parts"] == ["geometry", "joint series"]
        assert summary["robot"] == "ur5e"

    def test_the_error_bound_holds_for_95_of_100_poses_or_so(
        self, learned: CalibratedRobot
    ) -> None:
        robot = learned.robot
        joint_positions = learned_box(1000)
        bounds = np.array([robot.error_bound.at(row) for row in joint_positions])
        errors = pose_distance(
            TRUTH.poses(joint_positions), robot.forward_kinematics.poses(joint_positions)
        )
        for error, bound in zip(errors, bounds.T, strict=True):
            assert 0.85 <= (error <= bound).mean() <= 1.0
            # And it says something: it is not ten times too large.
            assert bound.mean() < 5.0 * np.quantile(error, 0.95)


@pytest.mark.slow
def test_a_stated_noise_that_the_residuals_contradict_is_not_used(
    from_fifty: CalibratedRobot,
) -> None:
    found, stated = from_fifty.estimate, from_fifty.dataset.measurement_noise
    assert stated is not None
    position, orientation = stated
    assert credible_noise(found, stated) == Noise(position, orientation)
    assert credible_noise(found, None) == Noise(0.0, 0.0)
    assert credible_noise(found, (10.0 * position, orientation)) == Noise(0.0, orientation)
    assert credible_noise(found, (position, 10.0 * orientation)) == Noise(position, 0.0)


@pytest.mark.slow
def test_with_far_too_large_a_stated_noise_the_bound_is_as_without_one() -> None:
    dataset = measured_ur5e(TRUTH, 50)
    wrong = calibrate(UR5E, replace(dataset, measurement_noise=(1e-3, 1e-2)), QUICK)
    unknown = calibrate(UR5E, replace(dataset, measurement_noise=None), QUICK)
    assert wrong.stated_noise == Noise(1e-3, 1e-2)
    assert unknown.stated_noise is None
    bounds = [one.robot.error_bound for one in (wrong, unknown)]
    assert bounds[0] is not None and bounds[1] is not None
    assert np.array_equal(bounds[0].coefficients, bounds[1].coefficients)
    assert any("1 mm" in warning for warning in warnings(wrong))
    assert not list(warnings(unknown))


@pytest.mark.slow
def test_residuals_beyond_the_noise_of_the_measurements_widen_the_error_bound(
    from_fifty: CalibratedRobot,
) -> None:
    """They are errors of the robot then."""
    estimate, centre = from_fifty.estimate, UR5E.joint_box.centre
    explained, unexplained = (
        error_bound_of(estimate, noise, np.random.default_rng(0)).at(centre)
        for noise in (estimate.noise, Noise(0.0, 0.0))
    )
    assert unexplained[0] > 1.5 * explained[0]
    assert unexplained[1] > 1.5 * explained[1]


@pytest.mark.slow
def test_gross_outliers_are_found_and_do_no_harm(from_fifty: CalibratedRobot) -> None:
    """A reflection, a marker that slipped, another row's orientation."""
    poses = from_fifty.dataset.poses.copy()
    poses[7, :3] += [0.003, -0.002, 0.001]
    poses[22, :3] += [0.0, 0.2, 0.0]
    poses[41, 3:] = poses[40, 3:]
    found = calibrate(UR5E, with_poses(from_fifty.dataset, poses), QUICK)
    assert np.flatnonzero(found.outliers).tolist() == [7, 22, 41]
    assert found.provenance["outliers"] == [7, 22, 41]
    ours, theirs = (distances(one.robot, TRUTH.poses, 1000).mean() for one in (found, from_fifty))
    assert ours == pytest.approx(theirs, rel=0.2)


class TestRefusals:
    """Poses that no robot can be calibrated with, and the errors."""

    @pytest.mark.parametrize("joint", [0, 2, 5])
    def test_a_joint_that_was_not_moved_is_named(self, joint: int) -> None:
        joint_positions = make_design(UR5E, "sobol", 30, 0)
        joint_positions[:, joint] = joint_positions[0, joint]
        with pytest.raises(DegenerateExamples) as caught:
            calibrate(UR5E, measured(UR5E, TRUTH.poses, joint_positions), QUICK)
        assert caught.value.joints == (UR5E.joint_names[joint],)
        assert f"in which {UR5E.joint_names[joint]} moves" in str(caught.value)

    @pytest.mark.parametrize(("position_only", "least"), [(False, 9), (True, 18)])
    def test_too_few(self, position_only: bool, least: int) -> None:
        with pytest.raises(TooFewMeasurements) as caught:
            calibrate(
                UR5E, measured_ur5e(TRUTH, least - 1), replace(QUICK, position_only=position_only)
            )
        assert (caught.value.examples, caught.value.least) == (least - 1, least)
        assert f"measure at least {least}, better" in str(caught.value)

    def test_rows_that_do_not_belong_together(self) -> None:
        dataset = measured_ur5e(TRUTH, 20)
        order = np.random.default_rng(0).permutation(20)
        with pytest.raises(UnexplainedMeasurements, match=r"check that .* belong together"):
            calibrate(UR5E, with_poses(dataset, dataset.poses[order]), QUICK)

    def test_too_few_without_the_outliers(self, monkeypatch: pytest.MonkeyPatch) -> None:
        outliers = np.arange(12) >= 8
        module = "annik_training.calibration.calibrate"
        monkeypatch.setattr(f"{module}.find_outliers", lambda *_: (outliers, None))
        with pytest.raises(TooFewMeasurements) as caught:
            calibrate(UR5E, measured_ur5e(TRUTH, 12), QUICK)
        assert (caught.value.examples, caught.value.least) == (8, 9)
        assert "besides 4 outliers" in str(caught.value)

    def test_poses_that_only_another_robot_explains(self) -> None:
        longer = replace(TRUTH, lengths=TRUTH.lengths + np.array([0.0, 0.1, 0, 0, 0, 0]))
        with pytest.raises(ImplausibleErrors) as caught:
            calibrate(UR5E, measured_ur5e(longer, 30), QUICK)
        assert caught.value.names == ("shoulder_lift_joint: length of the link after it",)
        # By the amount, which is known to a millimetre or so.
        (amount,) = re.findall(r"link after it (\S+) mm", str(caught.value))
        assert abs(float(amount)) == pytest.approx(100.0, abs=5.0)

    def test_a_probe_at_the_flange_is_calibrated(self) -> None:
        """It need not be in the description."""
        dataset = measured_ur5e(TRUTH, 40)
        poses = dataset.poses.copy()
        poses[:, :3] += Rotation.from_quat(poses[:, 3:]).apply([0.05, 0.0, 0.12])
        found = calibrate(UR5E, with_poses(dataset, poses), QUICK)
        joint_positions = learned_box(200)
        flange = TRUTH.matrices(joint_positions)
        probe = flange[:, :3, 3] + flange[:, :3, :3] @ [0.05, 0.0, 0.12]
        model = found.robot.forward_kinematics.poses(joint_positions)
        assert np.linalg.norm(model[:, :3] - probe, axis=1).mean() <= 4e-5

    @pytest.mark.parametrize(
        "spoil",
        [
            lambda poses: poses * [1e3, 1e3, 1e3, 1, 1, 1, 1],
            lambda poses: poses[:, [0, 1, 2, 6, 3, 4, 5]],
        ],
        ids=["millimetres", "w first"],
    )
    def test_other_units_and_orders(self, spoil: object) -> None:
        dataset = measured_ur5e(TRUTH, 30)
        with pytest.raises(UnexplainedMeasurements, match="metres, radians and quaternions"):
            calibrate(UR5E, with_poses(dataset, spoil(dataset.poses)), QUICK)

    def test_what_is_no_number(self) -> None:
        dataset = measured_ur5e(TRUTH, 30)
        poses = dataset.poses.copy()
        poses[4, 1] = np.nan
        with pytest.raises(NonFiniteValue) as caught:
            calibrate(UR5E, with_poses(dataset, poses), QUICK)
        assert caught.value.field == "row 4 of the poses"

    def test_what_is_no_nominal_arm(self, gantry: Robot, learned: CalibratedRobot) -> None:
        dataset = measured_ur5e(TRUTH, 30)
        for robot in (gantry, learned.robot):
            with pytest.raises(UnsupportedRobot) as caught:
                calibrate(robot, dataset, QUICK)
            assert robot.name in caught.value.robot
            assert caught.value.purpose == "calibration"

    def test_a_nominal_robot_with_other_joints_or_frames(self) -> None:
        dataset = measured_ur5e(TRUTH, 10)
        forearm = load_robot("ur5e", end_effector_frame="wrist_3_link")
        for other in (load_robot("xarm6"), forearm):
            with pytest.raises(RobotMismatch) as caught:
                calibrate(other, dataset, QUICK)
            assert other.end_effector_frame in caught.value.expected
            assert UR5E.end_effector_frame in caught.value.found


def test_another_description_of_the_same_robot_may_be_calibrated() -> None:
    """Its joint box is another than that of the dataset's robot."""
    narrow = load_robot("ur5e", joint_box={"wrist_3_joint": (-0.5, 0.5)})
    found = calibrate(narrow, measured_ur5e(TRUTH, 30), QUICK)
    assert found.dataset.robot is narrow
    assert found.robot.joint_box.upper.tolist() == narrow.joint_box.upper.tolist()
    assert distances(found.robot, TRUTH.poses, 500).mean() <= 4e-5


@pytest.mark.parametrize(
    "options",
    [
        {"seed": -1},
        {"restarts": 0},
        {"max_evaluations": 0},
        {"candidates": ()},
        {"candidates": (frozenset({Part.JOINT_SERIES}),)},
    ],
)
def test_options_out_of_range_are_named(options: dict[str, object]) -> None:
    with pytest.raises(InvalidValue) as caught:
        CalibrationOptions(**options)
    assert caught.value.name == next(iter(options))


@pytest.mark.slow
def test_a_locked_joint_is_no_obstacle() -> None:
    """Of seven joints one is locked; another is an arm with a prismatic one."""
    for name in ("iiwa14", "scara"):
        robot = load_robot(name)
        joint_positions = make_design(robot, "sobol", 30, 0)
        dataset = measured(robot, robot.forward_kinematics.poses, joint_positions)
        found = calibrate(robot, dataset, QUICK)
        assert distances(found.robot, robot.forward_kinematics.poses, 300).mean() <= 3e-5


class TestEvaluation:
    """Before and after, on poses that were not used."""

    def test_says_what_became_better(self, learned: CalibratedRobot, held_out: Dataset) -> None:
        evaluation = evaluate_measured(learned.robot, held_out)
        assert evaluation.before.distances.mean() > 2e-3
        # Mostly the noise of three coordinates.
        assert evaluation.after.distances.mean() == pytest.approx(1.6 * NOISE[0], rel=0.25)
        assert all(0.85 <= part <= 1.0 for part in evaluation.within_bounds)

    def test_regions_are_thirds_of_the_box(
        self, learned: CalibratedRobot, held_out: Dataset
    ) -> None:
        evaluation = evaluate_measured(learned.robot, held_out)
        assert len(evaluation.regions) == 6 * REGIONS
        for joint in UR5E.joint_names:
            rows = [region for region in evaluation.regions if region.joint == joint]
            index = UR5E.joint_names.index(joint)
            assert sum(row.examples for row in rows) == 400
            assert rows[0].lower == UR5E.joint_box.lower[index]
            assert rows[-1].upper == UR5E.joint_box.upper[index]
            positions = held_out.joint_positions[:, index]
            inside = (positions >= rows[1].lower) & (positions < rows[1].upper)
            assert rows[1].examples == inside.sum()
            assert rows[1].before == pytest.approx(evaluation.before.distances[inside].mean())
            assert rows[1].after == pytest.approx(evaluation.after.distances[inside].mean())

    def test_a_region_without_poses_is_none_in_json(
        self, learned: CalibratedRobot, held_out: Dataset
    ) -> None:
        lower = held_out.joint_positions[:, 0] < 0.0
        summary = evaluation_summary(evaluate_measured(learned.robot, held_out.rows(lower)))
        (row,) = [
            row
            for row in summary["regions"]
            if row["joint"] == "shoulder_pan_joint" and row["examples"] == 0
        ]
        assert (row["before"], row["after"]) == (None, None)

    def test_is_drawn(self, learned: CalibratedRobot, held_out: Dataset) -> None:
        """Also where a region is empty."""
        for dataset in (held_out, held_out.rows(held_out.joint_positions[:, 0] < 0.0)):
            png = before_and_after(evaluate_measured(learned.robot, dataset))
            assert png.startswith(b"\x89PNG")

    def test_refuses_poses_that_it_was_calibrated_with(self, learned: CalibratedRobot) -> None:
        with pytest.raises(NotHeldOut) as caught:
            evaluate_measured(learned.robot, learned.dataset)
        assert caught.value.examples == 102
        # Also under another description of the robot.
        other = load_robot("ur5e", joint_box={"wrist_3_joint": (0.0, 0.5)})
        with pytest.raises(NotHeldOut):
            evaluate_measured(learned.robot, replace(learned.dataset, robot=other))

    def test_refuses_what_was_not_calibrated(self, held_out: Dataset) -> None:
        with pytest.raises(NotCalibrated) as caught:
            evaluate_measured(UR5E, held_out)
        assert caught.value.robot == "ur5e"

    def test_refuses_poses_of_another_robot(self, learned: CalibratedRobot) -> None:
        xarm = load_robot("xarm6")
        joint_positions = xarm.joint_box.sample(5, np.random.default_rng(0))
        dataset = measured(xarm, xarm.forward_kinematics.poses, joint_positions)
        with pytest.raises(RobotMismatch) as caught:
            evaluate_measured(learned.robot, dataset)
        assert caught.value.expected.startswith("ur5e (shoulder_pan_joint, ")
        assert caught.value.found.startswith("xarm6 (joint1, ")

    def test_takes_another_description_of_the_same_robot(
        self, learned: CalibratedRobot, held_out: Dataset
    ) -> None:
        """As after ``annik calibrate --nominal``."""
        urdf = UR5E.definition["urdf"].replace("-0.425", "-0.4251")
        assert urdf != UR5E.definition["urdf"]
        other = robot_from_definition({**UR5E.definition, "urdf": urdf}, "other")
        evaluation = evaluate_measured(learned.robot, replace(held_out, robot=other))
        assert evaluation.after.distances.mean() < 5e-5


def test_errors_are_one_family() -> None:
    """Whoever calibrates catches them all as one class."""
    classes = [
        value
        for value in vars(errors).values()
        if isinstance(value, type) and value.__module__ == errors.__name__
    ]
    assert {NotCalibrated, NotHeldOut, NotMeasured, UnexplainedMeasurements} < set(classes)
    for error in classes:
        assert issubclass(error, errors.CalibrationError)
    assert issubclass(errors.CalibrationError, AnnikError)
