"""Imperfect arms: against a maker's table with errors in it, and as properties. Needs no ROS."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from support.processes import ROOT

from annik_core.errors import AnnikError, InvalidValue
from annik_core.pose import FloatArray, pose_distance
from annik_core.robots.library import load_robot, robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain
from annik_core.settings import settings_of
from annik_core.simulation.fake_robot import CommandOutsideLimits, FakeRobot
from annik_core.simulation.imperfections import (
    JOINT_ENTRIES,
    ImperfectionMagnitudes,
    Imperfections,
    InvalidImperfections,
    PeriodicTransmissionError,
    imperfect_kinematics,
    imperfections_from_dict,
    random_imperfections,
    read_imperfections,
)

UR5E = load_robot("ur5e")
ARMS = ("ur5e", "panda", "iiwa14", "puma560", "xarm6", "scara")
SEEDS = st.integers(0, 2**31 - 1)

# Universal Robots, "DH Parameters for calculations of kinematics and dynamics", UR5e: d, a, alpha.
QUARTER = np.pi / 2
UR5E_TABLE = (
    (0.1625, 0.0, QUARTER),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, QUARTER),
    (0.0997, 0.0, -QUARTER),
    (0.0996, 0.0, 0.0),
)
# Which way the table's x axis points along the common normal. annik's normal leads from an axis to
# the next one where they are parallel (a is negative: against x), and by the right hand from the
# direction of one to that of the other where they cross (against x for a negative alpha). The last
# joint has no next axis; its length and twist are along y.
UR5E_NORMALS = (1, -1, -1, 1, -1)


def imperfect(robot: Robot = UR5E, **entries: Any) -> Imperfections:
    """Those of a perfect arm but for some entries; a number is that of every joint."""
    given = {
        name: np.broadcast_to(value, robot.dof) if name in JOINT_ENTRIES else value
        for name, value in entries.items()
    }
    return dataclasses.replace(Imperfections.none(robot.dof), **given)


def within_limits(robot: Robot, count: int = 50, seed: int = 0) -> FloatArray:
    limits = robot.joint_limits
    return np.random.default_rng(seed).uniform(limits.lower, limits.upper, (count, robot.dof))


def turn(axis: str, angle: float) -> FloatArray:
    c, s = np.cos(angle), np.sin(angle)
    matrix = np.eye(4)
    matrix[:3, :3] = {
        "x": ((1, 0, 0), (0, c, -s), (0, s, c)),
        "y": ((c, 0, s), (0, 1, 0), (-s, 0, c)),
        "z": ((c, -s, 0), (s, c, 0), (0, 0, 1)),
    }[axis]
    return matrix


def shift(axis: str, amount: float) -> FloatArray:
    matrix = np.eye(4)
    matrix["xyz".index(axis), 3] = amount
    return matrix


def ur5e_by_table(errors: Imperfections, q: FloatArray) -> FloatArray:
    """The matrix (4, 4) of the flange in base_link, by the table with errors in it."""
    pose = np.diag([-1.0, -1.0, 1.0, 1.0])
    for joint, (d, a, alpha) in enumerate(UR5E_TABLE):
        theta = q[joint] + errors.joint_zero[joint]
        theta += errors.transmission_amplitude[joint] * np.sin(
            q[joint] + errors.transmission_phase[joint]
        )
        pose = pose @ turn("z", theta) @ shift("z", d + errors.joint_offset[joint])
        length, twist = errors.link_length[joint], errors.link_twist[joint]
        if joint < 5:
            sign = UR5E_NORMALS[joint]
            pose = pose @ shift("x", a + sign * length) @ turn("x", alpha + sign * twist)
        else:
            pose = pose @ shift("y", length) @ turn("y", twist)
    return pose


def matrix_of(pose: FloatArray) -> FloatArray:
    """The matrix (4, 4) of a pose, from the textbook formula."""
    x, y, z, w = pose[3:]
    matrix = np.eye(4)
    matrix[:3, 3] = pose[:3]
    matrix[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return matrix


def assert_as_by_table(errors: Imperfections, seed: int = 0) -> None:
    q = within_limits(UR5E, 20, seed)
    poses = imperfect_kinematics(UR5E, errors).poses(q)
    for positions, pose in zip(q, poses, strict=True):
        assert np.abs(matrix_of(pose) - ur5e_by_table(errors, positions)).max() < 1e-9


# --- kinematics -------------------------------------------------------------------------------


@given(SEEDS)
@settings(max_examples=30, deadline=None)
def test_an_imperfect_ur5e_is_its_makers_table_with_errors_in_it(seed: int) -> None:
    """Exactly, not only to first order; by matrices with nothing of annik in them."""
    assert_as_by_table(random_imperfections(UR5E, seed), seed)


@pytest.mark.parametrize("entry", ["joint_zero", "joint_offset", "link_length", "link_twist"])
@pytest.mark.parametrize("joint", range(6))
def test_each_error_alone_is_that_of_the_table(entry: str, joint: int) -> None:
    """Also a large one, so that no two could be swapped unseen."""
    assert_as_by_table(imperfect(**{entry: 0.05 * np.eye(6)[joint]}))


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_without_imperfections_is_as_described(name: str) -> None:
    robot = load_robot(name)
    q = within_limits(robot)
    kinematics = imperfect_kinematics(robot, Imperfections.none(robot.dof))
    np.testing.assert_allclose(
        kinematics.poses(q), robot.forward_kinematics.poses(q), rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("name", ARMS)
def test_an_error_of_a_zero_is_a_motion_of_its_joint(name: str) -> None:
    """By the angle for a joint that turns; the offset along its axis for one that shifts."""
    robot = load_robot(name)
    amounts = np.random.default_rng(1).uniform(-0.01, 0.01, robot.dof)
    turns = np.array(robot.joint_types) == "revolute"
    errors = imperfect(robot, joint_zero=amounts * turns, joint_offset=amounts * ~turns)
    q = within_limits(robot)
    moved = robot.forward_kinematics.poses(q + amounts)
    np.testing.assert_allclose(
        imperfect_kinematics(robot, errors).poses(q), moved, rtol=0, atol=1e-12
    )


def test_the_slopes_of_a_transmission_error_are_those_of_its_positions() -> None:
    rng = np.random.default_rng(2)
    error = PeriodicTransmissionError(rng.uniform(0, 0.2, 6), rng.uniform(0, 6, 6))
    q, step = within_limits(UR5E), 1e-6
    slopes = (error.actual(q + step) - error.actual(q - step)) / (2 * step)
    np.testing.assert_allclose(
        error.derivatives(q), slopes[..., None] * np.eye(6), rtol=0, atol=1e-8
    )


@pytest.mark.parametrize("name", ARMS)
def test_a_soft_joint_turns_as_the_weight_of_the_links_falls(name: str) -> None:
    """By its compliance times the derivative of the links' potential energy."""
    robot = load_robot(name)
    turns = np.array([kind != "prismatic" for kind in robot.joint_types])
    rng = np.random.default_rng(4)
    compliance = rng.uniform(1e-5, 1e-4, robot.dof) * turns
    mass = rng.uniform(0.5, 10.0, robot.dof)
    q, step = within_limits(robot, 5), 1e-5

    def energy(positions: FloatArray) -> float:
        frames = ScrewChain.from_urdf(robot.definition["urdf"]).frames(positions)
        return 9.81 * float(mass @ frames[1:, 2, 3])

    soft = imperfect_kinematics(robot, imperfect(robot, compliance=compliance, link_mass=mass))
    for positions in q:
        moved = [
            (energy(positions + by) - energy(positions - by)) / (2.0 * step)
            for by in step * np.eye(robot.dof)
        ]
        sagged = positions - compliance * moved
        np.testing.assert_allclose(
            soft.poses(positions[np.newaxis]),
            robot.forward_kinematics.poses(sagged[np.newaxis]),
            rtol=0,
            atol=1e-8,
        )
        # Every axis of a scara is vertical.
        assert (np.abs(sagged - positions).max() > 1e-5) == (name != "scara")


def test_what_an_arm_has_learned_does_not_change_the_real_one() -> None:
    """A model with corrections is of the same robot."""
    placements = np.tile([1e-3, 0, 0, 0, 0, 0, 1.0], (7, 1)).tolist()
    learned = robot_from_definition(
        {**UR5E.definition, "corrections": {"placements": placements}}, "the test's"
    )
    errors = random_imperfections(UR5E, 3)
    q = within_limits(UR5E)
    np.testing.assert_array_equal(
        imperfect_kinematics(learned, errors).poses(q), imperfect_kinematics(UR5E, errors).poses(q)
    )


# --- drawing ----------------------------------------------------------------------------------


@given(SEEDS, st.floats(0.0, 1.0))
@settings(max_examples=50, deadline=None)
def test_what_is_drawn_is_within_its_magnitude_and_the_same_for_a_seed(
    seed: int, share: float
) -> None:
    magnitudes = ImperfectionMagnitudes(
        **{entry.name: share * entry.maximum for entry in settings_of(ImperfectionMagnitudes)}
    )
    drawn = random_imperfections(UR5E, seed, magnitudes)
    again = random_imperfections(UR5E, seed, magnitudes)
    for name in (field.name for field in dataclasses.fields(drawn)):
        np.testing.assert_array_equal(getattr(drawn, name), getattr(again, name))
    for name, largest in (
        ("joint_zero", magnitudes.joint_zero_error),
        ("joint_offset", magnitudes.link_length_error),
        ("link_length", magnitudes.link_length_error),
        ("link_twist", magnitudes.link_twist_error),
        ("transmission_amplitude", magnitudes.transmission_error),
        ("backlash", magnitudes.backlash),
        ("compliance", magnitudes.joint_compliance),
        ("link_mass", magnitudes.link_mass),
    ):
        assert np.abs(getattr(drawn, name)).max() <= largest
    assert drawn.dropped == magnitudes.dropped_measurements


def test_another_seed_is_another_arm_and_another_magnitude_the_same_one_scaled() -> None:
    one, other = random_imperfections(UR5E, 1), random_imperfections(UR5E, 2)
    for name in ("joint_zero", "joint_offset", "link_length", "link_twist", "transmission_phase"):
        assert (getattr(one, name) != getattr(other, name)).all()
    twice = ImperfectionMagnitudes(link_length_error=2e-3)
    scaled = random_imperfections(UR5E, 1, twice)
    np.testing.assert_allclose(scaled.link_length, 2 * one.link_length, rtol=1e-12)
    np.testing.assert_array_equal(scaled.joint_zero, one.joint_zero)
    np.testing.assert_array_equal(scaled.transmission_phase, one.transmission_phase)


def test_by_default_an_arm_misses_by_millimetres() -> None:
    q = within_limits(UR5E, 200)
    nominal = UR5E.forward_kinematics.poses(q)
    for seed in range(5):
        real = imperfect_kinematics(UR5E, random_imperfections(UR5E, seed)).poses(q)
        distance, angle = pose_distance(nominal, real)
        assert 1e-3 < np.median(distance) < 20e-3
        assert np.radians(0.1) < np.median(angle) < np.radians(3.0)


def test_a_joint_that_shifts_has_no_gear() -> None:
    scara = load_robot("scara")
    drawn = random_imperfections(scara, 1)
    assert (drawn.transmission_amplitude > 0).tolist() == [True, True, False, True]
    with pytest.raises(InvalidImperfections, match=r"joint3 is 1e-05"):
        imperfect_kinematics(scara, imperfect(scara, compliance=[0, 0, 1e-5, 0]))
    with pytest.raises(InvalidImperfections, match=r"joint3 is 0\.01"):
        imperfect_kinematics(scara, imperfect(scara, transmission_amplitude=[0, 0, 0.01, 0]))


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("joint_zero_error", -0.1, "a number from 0 to 0.2 [rad]"),
        ("link_length_error", 1.0, "a number from 0 to 0.1 [m]"),
        ("backlash", float("nan"), "a number from 0 to 0.1 [rad or m]"),
        ("dropped_measurements", 1.5, "a number from 0 to 1"),
    ],
)
def test_magnitudes_out_of_range_are_refused(name: str, value: float, allowed: str) -> None:
    with pytest.raises(InvalidValue) as caught:
        ImperfectionMagnitudes(**{name: value})
    assert caught.value.name == name
    assert caught.value.value is value
    assert caught.value.allowed == allowed


@pytest.mark.parametrize("seed", [-1, 2**31, True, 0.5])
def test_a_seed_that_is_none_is_refused(seed: Any) -> None:
    with pytest.raises(InvalidValue) as caught:
        random_imperfections(UR5E, seed)
    assert (caught.value.name, caught.value.value) == ("seed", seed)


@pytest.mark.parametrize(
    ("entries", "name", "value"),
    [
        ({"joint_zero": 0.3}, "joint_zero of joint 1", 0.3),
        ({"link_length": [0, 0, 0, 0, 0, np.inf]}, "link_length of joint 6", np.inf),
        ({"link_twist": np.nan}, "link_twist of joint 1", np.nan),
        ({"backlash": -0.001}, "backlash of joint 1", -0.001),
        ({"position_noise": -1e-6}, "position_noise", -1e-6),
        ({"dropped": 1.1}, "dropped", 1.1),
        ({"noise_seed": -1}, "noise_seed", -1),
    ],
)
def test_imperfections_out_of_range_are_refused(entries: Any, name: str, value: float) -> None:
    with pytest.raises(InvalidValue) as caught:
        imperfect(**entries)
    assert caught.value.name == name
    np.testing.assert_equal(caught.value.value, value)


def test_imperfections_of_another_number_of_joints_are_refused() -> None:
    with pytest.raises(InvalidImperfections, match=r"joint_offset has shape \(5,\), not \(6,\)"):
        dataclasses.replace(Imperfections.none(6), joint_offset=np.zeros(5))
    with pytest.raises(InvalidImperfections, match="for 4 joints; ur5e has 6"):
        FakeRobot(UR5E, Imperfections.none(4))


def test_a_gantry_can_not_be_imperfect() -> None:
    gantry = load_robot("gantry")
    for refused in (
        lambda: random_imperfections(gantry, 1),
        lambda: FakeRobot(gantry, Imperfections.none(6)),
        lambda: imperfections_from_dict({}, gantry, "a file"),
    ):
        with pytest.raises(InvalidImperfections) as caught:
            refused()
        assert caught.value.source == "of gantry"


def test_no_number_is_printed_by_accident() -> None:
    """A learner that reads logs learns nothing."""
    drawn = random_imperfections(UR5E, 1)
    for text in (repr(drawn), str(drawn), repr(FakeRobot(UR5E, drawn))):
        assert not any(
            f"{number:.4g}" in text
            for name in JOINT_ENTRIES
            if name not in ("backlash", "compliance")
            for number in getattr(drawn, name)
        )


# --- files ------------------------------------------------------------------------------------


@given(SEEDS)
@settings(max_examples=20, deadline=None)
def test_a_file_gives_back_what_was_written(seed: int) -> None:
    drawn = random_imperfections(UR5E, seed, ImperfectionMagnitudes(backlash=1e-3))
    text = yaml.safe_dump(drawn.to_dict(UR5E.joint_names))
    read = imperfections_from_dict(yaml.safe_load(text), UR5E, "the test's")
    for entry in dataclasses.fields(Imperfections):
        np.testing.assert_array_equal(getattr(read, entry.name), getattr(drawn, entry.name))


def test_what_a_file_leaves_out_is_zero(tmp_path: Path) -> None:
    path = tmp_path / "arm.yaml"
    path.write_text("joints: {elbow_joint: {link_length: 1.0e-3}}\ndropped: 1\n", encoding="utf-8")
    read = read_imperfections(path, UR5E)
    assert read.link_length.tolist() == [0, 0, 1e-3, 0, 0, 0]
    assert read.dropped == 1.0
    assert not read.joint_zero.any()
    assert read.position_noise == read.noise_seed == 0


def test_the_example_is_an_imperfect_ur5e() -> None:
    """Of the size that an arm as delivered has."""
    errors = read_imperfections(ROOT / "config" / "imperfect_ur5e.yaml", UR5E)
    q = within_limits(UR5E, 200)
    real = imperfect_kinematics(UR5E, errors).poses(q)
    distance, _ = pose_distance(UR5E.forward_kinematics.poses(q), real)
    assert 1e-3 < np.median(distance) < 20e-3
    assert errors.position_noise > 0


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "the file is not a mapping; its keys are joints, position_noise"),
        ("[1, 2]", "the file is not a mapping"),
        ("noise: 0.1", "the file has the key 'noise', which is unknown; its keys are joints"),
        ("joints: [elbow_joint]", "joints is not a mapping; its keys are shoulder_pan_joint"),
        ("joints: {elbow: {}}", "joints has the key 'elbow'"),
        (
            "joints: {elbow_joint: }",
            "joints.elbow_joint is not a mapping; its keys are joint_zero",
        ),
        ("joints: {elbow_joint: {zero: 0.1}}", "joints.elbow_joint has the key 'zero'"),
        (
            "joints: {elbow_joint: {joint_zero: 2}}",
            "joints.elbow_joint.joint_zero is 2; allowed: a number from -0.2 to 0.2 [rad]",
        ),
        ("joints: {elbow_joint: {link_length: true}}", "joints.elbow_joint.link_length is True"),
        ("position_noise: 20e-6", "position_noise is '20e-6'; allowed: a number from 0 to 0.1"),
        ("position_noise: 20e-6", "write 2.0e-5"),
        ("dropped: .nan", "dropped is nan; allowed: a number from 0 to 1"),
        ("noise_seed: 1.5", "noise_seed is 1.5; allowed: an integer"),
        ("a: [", "not readable as YAML"),
        ("2001-99-99", "not readable as YAML"),
        ("\x00", "not readable as YAML"),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_what_is_wrong(
    tmp_path: Path, text: str, complaint: str
) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidImperfections) as caught:
        read_imperfections(path, UR5E)
    assert str(caught.value).startswith(f"imperfections {path}: ")
    assert complaint in str(caught.value)


def test_a_file_that_can_not_be_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidImperfections, match="file not found"):
        read_imperfections(tmp_path / "none.yaml", UR5E)
    with pytest.raises(InvalidImperfections, match="can't be read"):
        read_imperfections(tmp_path, UR5E)
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"joints: \xff")
    with pytest.raises(InvalidImperfections, match="can't be read"):
        read_imperfections(latin, UR5E)


# --- the robot --------------------------------------------------------------------------------


def test_the_real_end_effector_is_elsewhere_and_the_joints_look_as_commanded() -> None:
    errors = random_imperfections(UR5E, 7)
    fake = FakeRobot(UR5E, errors)
    command = UR5E.joint_box.centre + 0.1
    achieved = fake.move_to(command)
    np.testing.assert_array_equal(
        achieved, imperfect_kinematics(UR5E, errors).poses(command[np.newaxis])[0]
    )
    np.testing.assert_array_equal(fake.pose, achieved)
    np.testing.assert_array_equal(fake.joint_positions, command)
    distance, _ = pose_distance(UR5E.forward_kinematics.poses(command[np.newaxis])[0], achieved)
    assert distance > 1e-3
    assert fake.robot is UR5E


@given(st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=30), st.floats(1e-4, 0.1))
@settings(max_examples=50, deadline=None)
def test_a_joint_lags_half_its_backlash_behind_its_drive(
    positions: list[float], backlash: float
) -> None:
    """After a motion through all of the play; less of one moves it less, and never more."""
    play = backlash * np.eye(6)[0]
    fake = FakeRobot(UR5E, imperfect(backlash=play))
    start = UR5E.joint_box.centre
    before = 0.0
    lag = 0.0
    for position in positions:
        pose = fake.move_to(start + position * np.eye(6)[0])
        # The first joint turns all of the arm about the base's z.
        turned = start + (position - lag_after(lag, position - before, backlash)) * np.eye(6)[0]
        lag = lag_after(lag, position - before, backlash)
        expected = UR5E.forward_kinematics.poses(turned[np.newaxis])[0]
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-12)
        if abs(position - before) > backlash:
            assert lag == np.copysign(0.5 * backlash, position - before)
        before = position


def lag_after(lag: float, motion: float, backlash: float) -> float:
    """How far a joint is behind its drive, once that has moved on."""
    return min(max(lag + motion, -0.5 * backlash), 0.5 * backlash)


def test_a_refused_command_moves_neither_drive_nor_joint() -> None:
    fake = FakeRobot(UR5E, imperfect(backlash=0.01))
    pose = fake.pose
    with pytest.raises(CommandOutsideLimits):
        fake.move_to(UR5E.joint_box.centre + 9.0)
    np.testing.assert_array_equal(fake.pose, pose)


def test_measurements_scatter_about_where_the_end_effector_really_is() -> None:
    """Alike along and about every axis, by the given standard deviations, and without bias."""
    errors = random_imperfections(UR5E, 4)
    fake = FakeRobot(UR5E, errors)
    rng = errors.measurement_generator()
    measured = np.array([fake.measure(rng) for _ in range(4000)])
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_quat(measured[:, 3:]) * Rotation.from_quat(fake.pose[3:]).inv()
    for scatter, deviation in (
        (measured[:, :3] - fake.pose[:3], 20e-6),
        (turned.as_rotvec(), np.radians(0.002)),
    ):
        np.testing.assert_allclose(scatter.std(axis=0), deviation, rtol=0.05)
        assert np.abs(scatter.mean(axis=0)).max() < 4 * deviation / np.sqrt(4000)
        correlations = np.corrcoef(scatter.T) - np.eye(3)
        assert np.abs(correlations).max() < 0.08
    np.testing.assert_allclose(np.linalg.norm(measured[:, 3:], axis=1), 1.0, rtol=1e-12)
    again = errors.measurement_generator()
    np.testing.assert_array_equal([fake.measure(again) for _ in range(10)], measured[:10])


def test_measurements_are_lost_as_often_as_said() -> None:
    errors = imperfect(dropped=0.3)
    fake, rng = FakeRobot(UR5E, errors), errors.measurement_generator()
    lost = [fake.measure(rng) is None for _ in range(4000)]
    assert abs(np.mean(lost) - 0.3) < 0.03


def test_a_perfect_robot_is_measured_where_it_is() -> None:
    """The gantry too."""
    for name in ("gantry", "ur5e"):
        fake = FakeRobot(load_robot(name))
        measured = fake.measure(np.random.default_rng(0))
        assert measured is not None
        np.testing.assert_array_equal(measured, fake.pose)


def test_the_error_is_of_the_tree() -> None:
    assert issubclass(InvalidImperfections, AnnikError)
