"""Arms with corrections: their definition, kinematics and refinement. ROS-free."""

from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from support.arm_corrections import corrected, drawn_corrections, identity_corrections
from support.refused_definition import refused_definition
from support.urdf_texts import planar_arm

from annik_core.robots.corrections import ArmCorrections, quadratic_features
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.library import load_robot, packaged_robots, robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain
from annik_core.solver.refinement import Refinement

ARMS = tuple(name for name in packaged_robots() if name != "gantry")


@cache
def nominal_named(name: str) -> Robot:
    return load_robot(name)


@cache
def corrected_named(name: str) -> Robot:
    return corrected(nominal_named(name), drawn_corrections(nominal_named(name), 7))


@pytest.fixture(params=ARMS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def inside(robot: Robot, count: int, seed: int = 0) -> np.ndarray:
    """Joint positions in the working box, but not at its rim."""
    box = robot.joint_box
    share = np.random.default_rng(seed).uniform(0.1, 0.9, (count, robot.dof))
    return box.lower + share * (box.upper - box.lower)


def twist_matrix(linear: np.ndarray, angular: np.ndarray) -> np.ndarray:
    """``(4, 4)`` of a twist, by whose exponential things move."""
    x, y, z = angular
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    matrix[:3, 3] = linear
    return matrix


def matrix_of(pose: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(pose[3:]).as_matrix()
    matrix[:3, 3] = pose[:3]
    return matrix


def by_hand(robot: Robot, corrections: ArmCorrections, joint_positions: np.ndarray) -> np.ndarray:
    """``(4, 4)`` by exponentials of matrices, joint by joint, from the entries of the JSON."""
    chain, data = ScrewChain.from_urdf(robot.definition["urdf"]), corrections.to_dict()
    joints, pose = data["joint_networks"], data["pose_network"]
    matrix = matrix_of(np.array(data["placements"][0]))
    harmonics, deflection = data["joint_harmonics"], data["deflection"]
    scaled, nominal = [], [np.eye(4)]
    for joint, position in enumerate(joint_positions.tolist()):
        twist = twist_matrix(chain.axes[joint, :3], chain.axes[joint, 3:])
        nominal[-1] = nominal[-1] @ chain.placements[joint]
        nominal.append(nominal[-1] @ expm(position * twist))
    nominal[-1] = nominal[-1] @ chain.placements[-1]
    for joint, position in enumerate(joint_positions.tolist()):
        x = (position - joints["centre"][joint]) / joints["half_width"][joint]
        scaled.append(x)
        actual = position + sum(
            out * math.tanh(weight * x + bias)
            for out, weight, bias in zip(
                *(joints[key][joint] for key in ("output_weights", "input_weights", "biases")),
                strict=True,
            )
        )
        for order, (sine, cosine) in enumerate(
            zip(harmonics["sines"][joint], harmonics["cosines"][joint], strict=True), 1
        ):
            angle = order * harmonics["frequencies"][joint] * position
            actual += sine * math.sin(angle) + cosine * math.cos(angle)
        axis = chain.axes[joint, 3:]
        for place in range(joint, len(joint_positions)):
            lever = nominal[place + 1][:3, 3] - nominal[joint][:3, 3]
            moment = np.cross(lever, deflection["gravity"])
            actual += deflection["compliances"][joint][place] * (
                moment @ nominal[joint][:3, :3] @ axis
            )
        twist = twist_matrix(chain.axes[joint, :3], chain.axes[joint, 3:])
        matrix = matrix @ chain.placements[joint] @ expm(actual * twist)
        matrix = matrix @ matrix_of(np.array(data["placements"][joint + 1]))
    matrix = matrix @ chain.placements[-1]
    periodic = np.zeros(6)
    for number, wave in enumerate(data["pose_harmonics"]["waves"]):
        angle = sum(
            often * position
            for often, position in zip(wave, joint_positions.tolist(), strict=True)
        )
        for row in range(6):
            periodic[row] += data["pose_harmonics"]["cosines"][row][number] * math.cos(angle)
            periodic[row] += data["pose_harmonics"]["sines"][row][number] * math.sin(angle)
    matrix = matrix @ expm(twist_matrix(periodic[:3], periodic[3:]))
    hidden = np.tanh(np.array(pose["input_weights"]) @ scaled + np.array(pose["biases"]))
    motion = np.array(pose["output_weights"]) @ hidden
    return matrix @ expm(twist_matrix(motion[:3], motion[3:]))


def test_the_periodic_parts_are_the_same_after_a_turn() -> None:
    nominal = nominal_named("ur5e")
    drawn = drawn_corrections(nominal, 3)
    periodic = replace(drawn, joint_networks=None, pose_network=None)
    kinematics = corrected(nominal, periodic).forward_kinematics
    joint_positions = inside(nominal, 20)
    turned = kinematics.poses(joint_positions + 2.0 * math.pi * np.eye(6)[0])
    assert turned == pytest.approx(kinematics.poses(joint_positions), abs=1e-12)


class TestDefinition:
    """The entry ``corrections`` of a definition."""

    def test_comes_back_from_json_to_the_bit(self, name: str) -> None:
        robot = corrected_named(name)
        again = robot_from_definition(json.loads(json.dumps(robot.definition)), "again")
        assert again.definition == robot.definition
        assert again.definition_hash == robot.definition_hash
        joint_positions = inside(robot, 5)
        ours, theirs = again.forward_kinematics, robot.forward_kinematics
        assert np.array_equal(ours.poses(joint_positions), theirs.poses(joint_positions))
        assert again.error_bound is not None and robot.error_bound is not None
        assert again.error_bound.at(joint_positions[0]) == robot.error_bound.at(joint_positions[0])

    def test_is_part_of_the_hash(self) -> None:
        nominal = nominal_named("ur5e")
        hashes = {
            nominal.definition_hash,
            corrected_named("ur5e").definition_hash,
            corrected(nominal, drawn_corrections(nominal, 8)).definition_hash,
        }
        assert len(hashes) == 3

    def test_of_none_is_none(self) -> None:
        nominal = nominal_named("ur5e")
        robot = robot_from_definition({**nominal.definition, "corrections": None}, "x")
        assert robot.definition_hash == nominal.definition_hash
        assert robot.error_bound is None

    @pytest.mark.parametrize(
        "parts",
        [
            (),
            ("joint_networks",),
            ("pose_network",),
            ("joint_harmonics",),
            ("deflection",),
            ("pose_harmonics",),
        ],
    )
    def test_may_have_some_parts_only(self, parts: tuple[str, ...]) -> None:
        nominal = nominal_named("scara")
        drawn = drawn_corrections(nominal, 3)
        some = ArmCorrections(drawn.placements, **{part: getattr(drawn, part) for part in parts})
        data = corrected(nominal, some).definition["corrections"]
        assert set(data) == {"placements", *parts}

    def test_with_negative_w_is_the_same_motion(self) -> None:
        nominal = nominal_named("ur5e")
        drawn = drawn_corrections(nominal, 3)
        placements = drawn.placements.copy()
        placements[:, 3:] *= -1.0
        joint_positions = inside(nominal, 5)
        assert corrected(nominal, replace(drawn, placements=placements)).forward_kinematics.poses(
            joint_positions
        ) == pytest.approx(
            corrected(nominal, drawn).forward_kinematics.poses(joint_positions), abs=1e-14
        )


def changed(path: str, value: Any) -> dict[str, Any]:
    """The UR5e's corrections with one entry replaced, or taken away if the value is ``...``."""
    data = copy.deepcopy(dict(corrected_named("ur5e").definition["corrections"]))
    *folders, last = path.split(".")
    inner = data
    for folder in folders:
        inner = inner[folder]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return data


def refused(corrections: Any, *named: str) -> None:
    definition = {**nominal_named("ur5e").definition, "corrections": corrections}
    error = refused_definition(lambda: robot_from_definition(definition, "bad.yaml"), *named)
    assert error.source == "bad.yaml"


PLACEMENT = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        ("placements", [PLACEMENT] * 6, "(6, 7); (7, 7)"),
        ("placements", [PLACEMENT[:6]] * 7, "(7, 6); (7, 7)"),
        ("placements", None, "nothing"),
        ("placements", "none", "text"),
        ("placements", [*[PLACEMENT] * 6, [0.0]], "malformed"),
        ("placements", [*[PLACEMENT] * 6, [0.0] * 7], "unit quaternion"),
        ("placements", [*[PLACEMENT] * 6, [*PLACEMENT[:6], 2.0]], "unit quaternion"),
        ("placements", [*[PLACEMENT] * 6, [*PLACEMENT[:6], True]], "true"),
        ("placements", [*[PLACEMENT] * 6, [*PLACEMENT[:6], math.nan]], "not finite"),
        ("placements", [*[PLACEMENT] * 6, [math.inf, *PLACEMENT[1:]]], "not finite"),
        ("placements", [*[PLACEMENT] * 6, [10**400, *PLACEMENT[1:]]], "malformed"),
        (
            "screws",
            [],
            "placements; joint_harmonics; joint_networks; pose_network; pose_harmonics",
        ),
        ("joint_harmonics.sines", 0.0, "()"),
        ("joint_harmonics.cosines", [[0.0]] * 6, "(6, 1)"),
        ("joint_harmonics.frequencies", [0.0] * 6, "is not positive"),
        ("deflection.compliances", [[0.0] * 6] * 5, "(5, 6)"),
        ("deflection.gravity", [0.0, 0.0, -9.8], "is not a unit vector"),
        ("joint_networks", [], "is not a mapping"),
        ("joint_networks", False, "is not a mapping"),
        ("joint_networks.biases", ..., "is missing"),
        ("joint_networks.bias", 0, "is unknown"),
        ("joint_networks.biases", 0.0, "()"),
        ("joint_networks.input_weights", 0.0, "()"),
        ("joint_networks.output_weights", [[0.0]] * 6, "(6, 1)"),
        ("joint_networks.half_width", [1, 1, 1, 1, 1, 0], "is not positive"),
        ("joint_networks.half_width", [1, 1, 1, 1, 1, -1], "is not positive"),
        ("joint_networks.centre", [0] * 5, "(5,); (6,)"),
        ("joint_networks.centre", ["0"] * 6, "text"),
        ("pose_network", 1, "is not a mapping"),
        ("pose_network.centre", ..., "is missing"),
        ("pose_network.output_weights", [[0.0] * 4] * 5, "(5, 4)"),
        ("pose_network.half_width", [0.0] * 6, "is not positive"),
        ("joint_networks.half_width", [5e-324] * 6, "below 1e-09"),
        ("joint_networks.output_weights", [[1.7e308] * 4] * 6, "beyond 1e+06"),
        ("pose_network.output_weights", [[-1e308] * 4] * 6, "beyond 1e+06"),
        ("pose_harmonics.waves", [[0.0] * 5] * 5, "(5, 5)"),
        ("pose_harmonics.waves", 0.0, "()"),
        ("pose_harmonics.sines", [[0.0] * 5] * 3, "(3, 5)"),
        ("pose_harmonics.cosines", ..., "is missing"),
        ("error_bound", "small", "is not a mapping"),
        ("error_bound.coefficients", [[0.0] * 28], "(1, 28)"),
        ("error_bound.coefficients", [[4.0] * 28] * 2, "too large"),
        ("error_bound.half_width", [0.0] * 6, "is not positive"),
        ("error_bound.centre", None, "nothing"),
        ("provenance", "measured", "is not a mapping"),
        ("provenance", [], "is not a mapping"),
        ("provenance", False, "is not a mapping"),
    ],
)
def test_a_malformed_entry_is_refused_by_name(path: str, value: Any, named: str) -> None:
    """The path, and the words and values that tell what is wrong."""
    refused(changed(path, value), f"corrections.{path}", *named.split("; "))


def test_weights_and_biases_must_fit_each_other() -> None:
    for biases in (0.0, [0.0] * 3):
        refused(
            changed("pose_network.biases", biases),
            "corrections.pose_network.input_weights has shape",
        )


def test_placements_must_be_given() -> None:
    refused(changed("placements", ...), "'corrections' is not a mapping with placements")


@pytest.mark.parametrize("corrections", [True, 0, "none", [], [[0] * 7] * 7, {}])
def test_what_are_no_corrections_is_refused(corrections: Any) -> None:
    refused(corrections, "'corrections' is not a mapping with placements")


def test_a_refusal_is_the_same_every_time() -> None:
    """Of several slips the first by name, not one at random."""
    data = changed("joint_networks", {"zebra": 1, "apple": 2, "mango": 3, "centre": [0] * 6})
    refused(data, "corrections.joint_networks.apple", "unknown")


_JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=7)
        | st.dictionaries(
            st.sampled_from(["placements", "centre", "half_width", "biases", "x"]), inner
        )
    ),
    max_leaves=20,
)
_PATHS = [
    *("placements", "joint_networks", "pose_network", "error_bound", "provenance"),
    *("joint_harmonics.sines", "joint_harmonics.frequencies", "joint_harmonics"),
    *("deflection", "deflection.compliances", "deflection.gravity"),
    *("pose_harmonics", "pose_harmonics.waves", "pose_harmonics.sines"),
    *(
        f"{part}.{key}"
        for part in ("joint_networks", "pose_network")
        for key in ("centre", "half_width", "input_weights", "biases", "output_weights", "more")
    ),
    *(f"error_bound.{key}" for key in ("centre", "half_width", "coefficients")),
]


@settings(max_examples=100)
@given(st.lists(st.tuples(st.sampled_from(_PATHS), _JUNK), min_size=1, max_size=2), st.booleans())
def test_junk_is_taken_or_refused_but_never_raises_anything_else(
    changes: list[tuple[str, Any]], whole: bool
) -> None:
    data: Any = changes[0][1]
    if not whole:
        path, value = changes[0]
        data = changed(path, value)
    # Both by way of a definition, which is checked before, and directly.
    for read in (
        lambda: robot_from_definition(
            {**nominal_named("ur5e").definition, "corrections": data}, "x"
        ),
        lambda: ArmCorrections.from_dict(data, 6, "x"),
    ):
        try:
            read()
        except InvalidRobotDefinition as error:
            assert "x" in str(error)


_NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-(10**320), 10**320)


@settings(max_examples=40)
@given(st.data())
def test_any_numbers_of_the_right_shape_are_taken_or_refused(data: st.DataObject) -> None:
    """And what was taken computes: poses, bounds, whatever they are."""
    path = data.draw(st.sampled_from([path for path in _PATHS if "." in path]))
    if path.endswith(".more"):
        return
    part, key = path.split(".")
    known = np.array(corrected_named("ur5e").definition["corrections"][part][key])
    flat = known.ravel().tolist()
    for index in data.draw(st.lists(st.integers(0, len(flat) - 1), min_size=1, max_size=4)):
        flat[index] = data.draw(_NUMBERS)
    nested = flat
    if known.ndim == 2:
        width = known.shape[1]
        nested = [flat[start : start + width] for start in range(0, len(flat), width)]
    definition = {**nominal_named("ur5e").definition, "corrections": changed(path, nested)}
    try:
        robot = robot_from_definition(definition, "x")
    except InvalidRobotDefinition as error:
        assert f"corrections.{path}" in str(error)
        return
    with np.errstate(all="ignore"):
        joint_positions = inside(robot, 2)
        poses = robot.forward_kinematics.poses(joint_positions)
        assert np.isfinite(poses).all()
        assert robot.error_bound is not None
        assert all(math.isfinite(bound) for bound in robot.error_bound.at(joint_positions[0]))


class TestKinematics:
    """Poses, Jacobians and searches of a corrected arm."""

    def test_poses_are_those_by_hand(self, name: str) -> None:
        nominal, robot = nominal_named(name), corrected_named(name)
        corrections = drawn_corrections(nominal, 7)
        joint_positions = inside(nominal, 10)
        poses = robot.forward_kinematics.poses(joint_positions)
        for row, pose in zip(joint_positions, poses, strict=True):
            assert matrix_of(pose) == pytest.approx(by_hand(nominal, corrections, row), abs=1e-9)
        assert (poses[:, 6] >= 0.0).all()
        # And they are not the nominal ones.
        away = np.linalg.norm(
            poses[:, :3] - nominal.forward_kinematics.poses(joint_positions)[:, :3], axis=1
        )
        assert away.min() > 1e-4

    def test_screws_are_the_chain(self, name: str) -> None:
        robot = nominal_named(name)
        kinematics = robot.forward_kinematics
        chain = ScrewChain.from_urdf(robot.definition["urdf"])
        joint_positions = inside(robot, 1)[0]
        matrix = np.eye(4)
        for placement, axis, position in zip(
            chain.placements[:-1], chain.axes, joint_positions, strict=True
        ):
            matrix = matrix @ placement @ expm(position * twist_matrix(axis[:3], axis[3:]))
        pose = kinematics.poses(joint_positions[np.newaxis])[0]
        assert matrix @ chain.placements[-1] == pytest.approx(matrix_of(pose), abs=1e-12)

    def test_that_correct_nothing_are_the_nominal_ones(self, name: str) -> None:
        nominal = nominal_named(name)
        robot = corrected(nominal, identity_corrections(nominal))
        joint_positions = inside(nominal, 20)
        ours, theirs = robot.forward_kinematics, nominal.forward_kinematics
        assert ours.poses(joint_positions) == pytest.approx(
            theirs.poses(joint_positions), abs=1e-12
        )
        assert ours.jacobians(joint_positions) == pytest.approx(
            theirs.jacobians(joint_positions), abs=1e-12
        )

    @pytest.mark.parametrize(("motion", "tolerance"), [(False, 1e-7), (True, 2e-3)])
    def test_jacobians_are_finite_differences(
        self, name: str, motion: bool, tolerance: float
    ) -> None:
        """But for the end effector's motion, whose own change with the joints they leave out."""
        nominal = nominal_named(name)
        corrections = drawn_corrections(nominal, 5)
        if not motion:
            corrections = replace(corrections, pose_network=None, pose_harmonics=None)
        kinematics = corrected(nominal, corrections).forward_kinematics
        (joint_positions,) = inside(nominal, 1, seed=4)
        jacobian = kinematics.jacobians(joint_positions[np.newaxis])[0]
        step = 1e-5
        for joint in range(nominal.dof):
            move = np.zeros(nominal.dof)
            move[joint] = step
            before, after = kinematics.poses(
                np.array([joint_positions - move, joint_positions + move])
            )
            turn = Rotation.from_quat(after[3:]) * Rotation.from_quat(before[3:]).inv()
            difference = np.concatenate([after[:3] - before[:3], turn.as_rotvec()]) / (2 * step)
            assert jacobian[:, joint] == pytest.approx(difference, abs=tolerance)

    @pytest.mark.parametrize(("motion", "tolerance"), [(False, 1e-5), (True, 2e-3)])
    def test_linearised_errors_are_finite_differences(
        self, name: str, motion: bool, tolerance: float
    ) -> None:
        """At the target, where the logarithm's own derivative is one."""
        nominal = nominal_named(name)
        corrections = drawn_corrections(nominal, 6)
        if not motion:
            corrections = replace(corrections, pose_network=None, pose_harmonics=None)
        kinematics = corrected(nominal, corrections).forward_kinematics
        (joint_positions,) = inside(nominal, 1, seed=5)
        target = kinematics.poses(joint_positions[np.newaxis])[0]
        at_target = kinematics.linearise(joint_positions, target)
        jacobian = at_target.jacobian
        assert at_target.twist == pytest.approx(np.zeros(6), abs=1e-12)
        for joint in range(nominal.dof):
            move = np.zeros(nominal.dof)
            move[joint] = 1e-5
            before = kinematics.linearise(joint_positions - move, target).twist
            after = kinematics.linearise(joint_positions + move, target).twist
            assert (before - after) / 2e-5 == pytest.approx(jacobian[:, joint], abs=tolerance)

    def test_error_and_residuals_are_of_the_corrected_pose(self, name: str) -> None:
        """The distance, far from the target's orientation, to the end effector's own motion."""
        robot = corrected_named(name)
        kinematics = robot.forward_kinematics
        joint_positions, other = inside(robot, 2, seed=8)
        target, achieved = kinematics.poses(np.array([joint_positions, other]))
        distance = float(np.linalg.norm(target[:3] - achieved[:3]))
        turn = Rotation.from_quat(target[3:]) * Rotation.from_quat(achieved[3:]).inv()
        error = kinematics.linearise(other, target)
        position, orientation = error.residuals
        assert position == pytest.approx(distance, abs=5e-4 * turn.magnitude())
        assert orientation == pytest.approx(turn.magnitude(), abs=1e-9)
        assert kinematics.residuals(other, target) == pytest.approx(error.residuals, rel=1e-12)
        # A value: another target, asked for in between, has no effect on it.
        kinematics.linearise(joint_positions, target)
        assert error.residuals == (position, orientation)

    def test_refinement_converges(self, name: str) -> None:
        """To half a micrometre, in the box, with hardly a step more than the nominal arm takes."""
        nominal, robot = nominal_named(name), corrected_named(name)
        joint_positions = inside(robot, 60, seed=2)
        away = np.random.default_rng(1).uniform(-0.02, 0.02, joint_positions.shape)
        steps = []
        for one in (nominal, robot):
            refinement = Refinement(one.forward_kinematics, one.joint_box)
            taken = 0
            targets = one.forward_kinematics.poses(joint_positions)
            for start, target in zip(joint_positions + away, targets, strict=True):
                refined = refinement.refine(start, target)
                assert refined.converged
                assert one.joint_box.contains(refined.joint_positions)
                reached = one.forward_kinematics.poses(refined.joint_positions[np.newaxis])[0]
                assert np.linalg.norm(reached[:3] - target[:3]) <= 5.1e-7
                taken += refined.newton_steps
            steps.append(taken)
        assert steps[1] <= steps[0] + len(joint_positions)


class TestWorkspace:
    """What a corrected arm reaches is in its workspace."""

    @pytest.mark.parametrize("seed", range(6))
    def test_holds_a_stretched_arm(self, seed: int) -> None:
        """Also by as much as networks make it longer than its links."""
        nominal = load_robot(planar_arm())
        robot = corrected(nominal, drawn_corrections(nominal, seed))
        poses = robot.forward_kinematics.poses(np.zeros((1, nominal.dof)))
        assert robot.workspace.resolve(poses[0], None).violation is None


class TestErrorBound:
    """The bound as a function of the joint positions."""

    def test_is_the_exponential_of_a_quadratic(self) -> None:
        robot = corrected_named("ur5e")
        bound, box = robot.error_bound, robot.joint_box
        assert bound is not None
        (joint_positions,) = inside(robot, 1)
        x = (joint_positions - box.centre) / (0.5 * (box.upper - box.lower))
        terms = [1.0, *x, *(x[i] * x[j] for i in range(6) for j in range(i, 6))]
        assert quadratic_features(x[np.newaxis])[0] == pytest.approx(terms)
        logarithms = np.array(bound.coefficients) @ terms
        assert bound.at(joint_positions) == pytest.approx(tuple(np.exp(logarithms)), rel=1e-12)

    def test_stays_what_it_is_at_the_rim_beyond_it(self) -> None:
        robot = corrected_named("ur5e")
        bound, box = robot.error_bound, robot.joint_box
        assert bound is not None
        assert bound.at(box.upper + 3.0) == pytest.approx(bound.at(box.upper), rel=1e-12)
        assert bound.at(box.lower - 1e300) == pytest.approx(bound.at(box.lower), rel=1e-12)
