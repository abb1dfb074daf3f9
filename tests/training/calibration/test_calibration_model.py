"""The parametric model, its estimate, and leave-one-out residuals. ROS-free."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.imperfect_ur5e import NOISE, ImperfectUr5e, measured_ur5e

from annik_core.errors import NonFiniteValue
from annik_core.robots.library import load_robot, packaged_robots, robot_from_definition
from annik_core.robots.robot import Robot
from annik_training.calibration.estimation import Estimate, estimate
from annik_training.calibration.model import ParametricModel, Part, check_nominal_arm
from annik_training.calibration.observations import Noise, Observations
from annik_training.errors import UnsupportedRobot

ARMS = tuple(name for name in packaged_robots() if name != "gantry")
EVERYTHING = frozenset(Part)
SOME = (
    frozenset({Part.GEOMETRY}),
    frozenset({Part.GEOMETRY, Part.JOINT_NETWORKS}),
    frozenset({Part.ALIGNMENT, Part.POSE_NETWORK}),
    EVERYTHING,
)


@cache
def robot_named(name: str) -> Robot:
    return load_robot(name)


@pytest.fixture(params=ARMS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return robot_named(request.param)


@pytest.fixture(params=SOME, ids=lambda parts: "+".join(sorted(part.name for part in parts)))
def parts(request: pytest.FixtureRequest) -> frozenset[Part]:
    return frozenset(request.param)


def drawn(model: ParametricModel, seed: int = 0) -> np.ndarray:
    """Parameters as likely as any."""
    return np.random.default_rng(seed).normal(size=model.size)


class TestModel:
    """What it says for given parameters."""

    def test_is_the_robot_of_its_corrections(self, robot: Robot, parts: frozenset[Part]) -> None:
        """Whose kinematics Pinocchio computes."""
        model = ParametricModel(robot, parts)
        parameters = drawn(model)
        data = model.corrections(parameters).to_dict()
        corrected = robot_from_definition({**robot.definition, "corrections": data}, "x")
        joint_positions = robot.joint_box.sample(20, np.random.default_rng(1))
        poses = corrected.forward_kinematics.poses(joint_positions)
        positions, rotations = model.positions_and_rotations(parameters, joint_positions)
        assert positions == pytest.approx(poses[:, :3], abs=1e-9)
        expected = Rotation.from_quat(poses[:, 3:]).as_matrix()
        assert rotations == pytest.approx(expected, abs=1e-9)

    def test_is_the_nominal_robot_to_begin_with(self, robot: Robot) -> None:
        model = ParametricModel(robot, frozenset({Part.GEOMETRY, Part.ALIGNMENT}))
        start = model.start(np.random.default_rng(0))
        joint_positions = robot.joint_box.sample(5, np.random.default_rng(1))
        positions, _ = model.positions_and_rotations(start, joint_positions)
        poses = robot.forward_kinematics.poses(joint_positions)
        assert positions == pytest.approx(poses[:, :3], abs=1e-12)

    def test_names_are_as_many_as_parameters(self, robot: Robot, parts: frozenset[Part]) -> None:
        model = ParametricModel(robot, parts)
        assert len(model.names) == model.size == len(model.start(np.random.default_rng(0)))
        assert len(model.errors) == len(set(model.names[: len(model.errors)]))

    def test_known_masses_are_a_compliance_of_each_joint(self) -> None:
        """The same turn per newton metre, whichever link causes it."""
        masses = (5.0, 4.0, 3.0, 2.0, 1.0, 0.5)
        robot = replace(robot_named("ur5e"), masses=masses)
        model = ParametricModel(robot, frozenset({Part.GEOMETRY, Part.DEFLECTION}))
        assert model.size == len(model.names) == len(model.errors) + 21 + 6
        parameters = np.zeros(model.size)
        parameters[-5] = 1.0
        deflection = model.corrections(parameters).deflection
        assert deflection is not None
        turns = deflection.compliances[1, 1:] / masses[1:]
        assert turns == pytest.approx(turns[0])
        assert 1e-5 < turns[0] / 9.81 < 1e-4
        joint_positions = robot.joint_box.sample(5, np.random.default_rng(1))
        step = 1e-4
        moved = parameters.copy()
        moved[-5] += step
        before, after = (
            model.positions_and_rotations(these, joint_positions)[0]
            for these in (parameters, moved)
        )
        columns = model.evaluate(parameters, joint_positions).columns
        assert columns[:, :3, -5] == pytest.approx((after - before) / step, abs=1e-7)

    def test_derivatives_are_finite_differences(
        self, robot: Robot, parts: frozenset[Part]
    ) -> None:
        """But for the pose network's, whose own small turn they leave out."""
        model = ParametricModel(robot, parts)
        parameters = drawn(model, 2)
        joint_positions = robot.joint_box.sample(3, np.random.default_rng(3))
        evaluated = model.evaluate(parameters, joint_positions)
        positions, rotations = model.positions_and_rotations(parameters, joint_positions)
        assert np.array_equal(evaluated.positions, positions)
        assert np.array_equal(evaluated.rotations, rotations)
        step = 1e-4
        for index in range(model.size):
            move = np.zeros(model.size)
            move[index] = step
            before = model.positions_and_rotations(parameters - move, joint_positions)
            after = model.positions_and_rotations(parameters + move, joint_positions)
            turns = Rotation.from_matrix(after[1] @ np.swapaxes(before[1], 1, 2)).as_rotvec()
            difference = np.concatenate([after[0] - before[0], turns], axis=1) / (2 * step)
            # A natural unit is about a millimetre at the end effector.
            tolerance = 3e-6 if Part.POSE_NETWORK in parts else 1e-9
            assert evaluated.columns[:, :, index] == pytest.approx(difference, abs=tolerance)

    def test_of_a_calibrated_robot_or_the_gantry_there_is_none(self, gantry: Robot) -> None:
        nominal = robot_named("ur5e")
        model = ParametricModel(nominal, frozenset({Part.GEOMETRY}))
        data = model.corrections(np.zeros(model.size)).to_dict()
        learned = robot_from_definition({**nominal.definition, "corrections": data}, "x")
        for robot in (learned, gantry):
            with pytest.raises(UnsupportedRobot) as caught:
                check_nominal_arm(robot)
            assert robot.name in caught.value.robot


class TestFit:
    """A fit of the geometry to 40 measured poses, and the linear model around it."""

    @pytest.fixture(scope="class")
    def observations(self) -> Observations:
        truth = replace(ImperfectUr5e.drawn(4), amplitudes=np.zeros(6))
        return Observations.of(measured_ur5e(truth, 40))

    @pytest.fixture(scope="class")
    def fitted(self, observations: Observations) -> Estimate:
        model = ParametricModel(robot_named("ur5e"), frozenset({Part.GEOMETRY}))
        return estimate(model, observations, Noise(*NOISE), np.zeros(model.size))

    def test_finds_what_is_wrong(self, fitted: Estimate) -> None:
        """To the noise: the residuals are as large as the degrees of freedom let them be."""
        truth = replace(ImperfectUr5e.drawn(4), amplitudes=np.zeros(6))
        named = dict(zip(fitted.model.names, fitted.parameters, strict=True))
        twist = named["elbow_joint: twist of the link after it"] * np.radians(0.3)
        assert abs(twist) == pytest.approx(abs(truth.twists[2]), abs=1e-4)
        mean = float((fitted.residuals**2).sum()) / fitted.degrees_of_freedom
        assert mean == pytest.approx(1.0, abs=0.3)

    def test_left_out_residuals_are_those_of_fits_without_one_example(
        self, fitted: Estimate, observations: Observations
    ) -> None:
        for left_out in range(0, 40, 8):
            others = np.arange(40) != left_out
            refitted = estimate(
                fitted.model, observations.where(others), fitted.noise, fitted.parameters
            )
            alone = observations.where(~others)
            where = fitted.model.positions_and_rotations(
                refitted.parameters, alone.joint_positions
            )
            (explicit,) = alone.residuals(*where, fitted.noise)
            difference = np.linalg.norm(fitted.left_out_residuals[left_out] - explicit)
            assert difference <= 0.02 * np.linalg.norm(explicit)

    @pytest.mark.usefixtures("one_thread")
    def test_left_out_residuals_with_networks_are_near(self, observations: Observations) -> None:
        parts = frozenset({Part.GEOMETRY, Part.JOINT_NETWORKS})
        model = ParametricModel(robot_named("ur5e"), parts)
        start = model.start(np.random.default_rng(0))
        fitted = estimate(model, observations, Noise(*NOISE), start, 60)
        squares = []
        for left_out in range(0, 40, 8):
            others = np.arange(40) != left_out
            refitted = estimate(
                model, observations.where(others), fitted.noise, fitted.parameters, 20
            )
            alone = observations.where(~others)
            where = model.positions_and_rotations(refitted.parameters, alone.joint_positions)
            (explicit,) = alone.residuals(*where, fitted.noise)
            squares.append(
                (
                    float((fitted.left_out_residuals[left_out] ** 2).sum()),
                    float(explicit @ explicit),
                )
            )
        by_formula, by_refit = np.array(squares).sum(axis=0)
        assert by_formula == pytest.approx(by_refit, rel=0.1)

    def test_covariance_is_that_of_a_linear_model(self, fitted: Estimate) -> None:
        derivatives = fitted.derivatives.reshape(-1, fitted.model.size)
        precision = derivatives.T @ derivatives + np.eye(fitted.model.size)
        assert fitted.covariance @ precision == pytest.approx(np.eye(fitted.model.size), abs=1e-5)
        assert fitted.root @ fitted.root.T == pytest.approx(fitted.covariance, abs=1e-14)
        assert 0.0 < fitted.leverages.min(initial=1.0, where=np.eye(6, dtype=bool)) <= 1.0

    def test_without_weight_an_example_says_nothing(self, observations: Observations) -> None:
        model = ParametricModel(robot_named("ur5e"), frozenset({Part.GEOMETRY}))
        weights = np.ones(40)
        weights[7] = 0.0
        spoiled = replace(observations, positions=observations.positions.copy())
        spoiled.positions[7] += 1.0
        results = [
            estimate(model, each, Noise(*NOISE), np.zeros(model.size)).parameters
            for each in (spoiled.weighted(weights), observations.where(weights > 0.0))
        ]
        assert results[0] == pytest.approx(results[1], abs=1e-5)

    def test_covariance_of_hardly_any_noise_is_one(self, fitted: Estimate) -> None:
        """Positive definite, though derivatives and prior are ten orders of magnitude apart."""
        model = ParametricModel(robot_named("ur5e"), EVERYTHING)
        sharp = Estimate(model, drawn(model), fitted.observations, Noise(1e-9, 1e-9))
        assert np.isfinite(sharp.root).all()
        assert np.linalg.eigvalsh(sharp.covariance).min() > -1e-12
        assert (np.diag(sharp.covariance) <= 1.0 + 1e-9).all()


class TestObservations:
    """Measured poses as the fit sees them."""

    def test_a_quaternion_and_its_negative_are_the_same(self) -> None:
        dataset = measured_ur5e(ImperfectUr5e.drawn(1), 8)
        poses = dataset.poses.copy()
        poses[::2, 3:] *= -1.0
        ours, theirs = Observations.of(dataset), Observations.of(replace(dataset, poses=poses))
        assert np.array_equal(ours.rotations, theirs.rotations)

    def test_residuals_are_in_standard_deviations(self) -> None:
        dataset = measured_ur5e(ImperfectUr5e.drawn(1), 8)
        observations = Observations.of(dataset)
        noise = Noise(2e-3, 4e-3)
        turn = Rotation.from_rotvec([0.0, 0.0, 4e-3]).as_matrix()
        residuals = observations.residuals(
            observations.positions + np.array([2e-3, 0.0, -4e-3]),
            turn @ observations.rotations,
            noise,
        )
        assert residuals == pytest.approx(np.tile([1.0, 0, -2.0, 0, 0, 1.0], (8, 1)), abs=1e-9)

    @pytest.mark.parametrize("number", [np.nan, np.inf])
    def test_what_is_no_number_is_refused(self, number: float) -> None:
        dataset = measured_ur5e(ImperfectUr5e.drawn(1), 8)
        poses = dataset.poses.copy()
        poses[3, 5] = number
        with pytest.raises(NonFiniteValue) as caught:
            Observations.of(replace(dataset, poses=poses))
        assert caught.value.field == "row 3 of the poses"
        assert len(Observations.of(replace(dataset, poses=poses), position_only=True)) == 8
        joint_positions = dataset.joint_positions.copy()
        joint_positions[2, 1] = number
        with pytest.raises(NonFiniteValue) as caught:
            Observations.of(replace(dataset, joint_positions=joint_positions))
        assert caught.value.field == "row 2 of the joint positions"
