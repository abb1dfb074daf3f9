"""Systems: values against the paper and geometry, derivatives, errors. ROS-free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from annik_core.robots.gantry import GantryKinematics
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.thirty_phase_design import thirty_phase_design
from annik_training.fitting.problem import InverseKinematicsSystem
from benchmarks.paper.example_sets import paper_robot, robot_set
from benchmarks.systems.elbow_arm import ElbowArm
from benchmarks.systems.function_system import interaction, paper_functions
from benchmarks.systems.library import MeasuredSystem, RobotSystem

EACH_SYSTEM = pytest.mark.parametrize(
    "make",
    [
        paper_functions,
        interaction,
        ElbowArm,
        lambda: ElbowArm(height=0.1, upper_arm=0.5, forearm=0.2),
        *(
            lambda name=name: RobotSystem(load_robot(name))
            for name in ("gantry", "ur5e", "panda", "scara")
        ),
    ],
    ids=["F", "interaction", "elbow_arm", "another_elbow_arm", "gantry", "ur5e", "panda", "scara"],
)


def inside(system: MeasuredSystem, count: int = 20, seed: int = 0) -> np.ndarray:
    """Random joint positions, not quite up to the edges of the box."""
    box = system.joint_box
    share = np.random.default_rng(seed).uniform(0.01, 0.99, (count, len(box.joint_names)))
    return box.lower + share * (box.upper - box.lower)


@EACH_SYSTEM
@pytest.mark.parametrize("of", ["input", "target"])
def test_derivatives_are_those_of_the_values(make: Callable[[], MeasuredSystem], of: str) -> None:
    system = make()
    values = getattr(system, f"{of}s")
    joint_positions = inside(system)
    step = 1e-5
    numerical = [
        (values(joint_positions + move) - values(joint_positions - move)) / (2.0 * step)
        for move in step * np.eye(joint_positions.shape[1])
    ]
    derivatives = getattr(system, f"{of}_jacobians")(joint_positions)
    assert derivatives == pytest.approx(np.stack(numerical, axis=2), abs=1e-8)


@EACH_SYSTEM
def test_right_answers_have_no_error_and_wrong_ones_do(make: Callable[[], MeasuredSystem]) -> None:
    system = make()
    joint_positions = inside(system)
    targets = system.targets(joint_positions)
    assert system.errors(joint_positions, targets) == pytest.approx(np.zeros(20), abs=1e-9)
    wrong = targets + np.where(np.arange(20) == 3, 0.01, 0.0)[:, np.newaxis]
    errors = system.errors(joint_positions, wrong)
    assert errors[3] > 1e-3
    assert np.delete(errors, 3) == pytest.approx(np.zeros(19), abs=1e-9)


@EACH_SYSTEM
def test_the_target_box_is_where_the_targets_are(make: Callable[[], MeasuredSystem]) -> None:
    """And no wider: the corners of the joint box reach its ends."""
    system = make()
    lower, upper = system.target_box
    box = system.joint_box
    corners = np.array(np.meshgrid(*zip(box.lower, box.upper, strict=True))).reshape(
        len(box.lower), -1
    )
    targets = system.targets(np.concatenate([corners.T, inside(system, 500)]))
    assert targets.min(axis=0) == pytest.approx(lower, abs=1e-12)
    assert targets.max(axis=0) == pytest.approx(upper, abs=1e-12)


class TestFunctions:
    @pytest.mark.parametrize(
        ("degrees", "printed"),
        [
            (0.5, (0.087265, 0.000381, 0.000309, 0.055556)),
            (89.5, (9.999619, 9.912735, 9.889198, 9.944444)),
        ],
    )
    def test_F_is_what_the_paper_prints(self, degrees: float, printed: tuple[float, ...]) -> None:
        """Table 3, in which the last three functions have one column."""
        f = paper_functions().targets(np.radians(np.full((1, 6), degrees)))[0]
        assert f == pytest.approx([*printed, printed[3], printed[3]], abs=5.1e-7)

    def test_each_function_of_F_has_its_own_joint(self) -> None:
        q = inside(paper_functions(), 1)
        for joint in range(6):
            moved = q.copy()
            moved[0, joint] += 0.1
            change = paper_functions().targets(moved) - paper_functions().targets(q)
            assert np.flatnonzero(change[0]).tolist() == [joint]

    def test_the_error_is_rms_over_the_outputs(self) -> None:
        q = inside(paper_functions(), 2)
        off = np.array([[3.0, 4.0, 0, 0, 0, 0], [0, 0, 0, 0, 0, -1.0]])
        assert paper_functions().errors(q, paper_functions().targets(q) + off) == pytest.approx(
            np.sqrt([25 / 6, 1 / 6])
        )

    def test_the_interaction_is_hidden_from_the_papers_design(self) -> None:
        system = interaction()
        examples = thirty_phase_design(system.joint_box, 6)
        assert system.targets(examples) == pytest.approx(np.zeros((len(examples), 1)), abs=1e-12)
        assert np.abs(system.targets(inside(system))).max() > 0.1


class TestElbowArm:
    def test_its_tip_is_where_the_rotations_take_it(self) -> None:
        arm = ElbowArm()
        for q, tip in zip(inside(arm), arm.inputs(inside(arm)), strict=True):
            base = Rotation.from_euler("z", q[0])
            # About y, up is negative.
            shoulder, elbow = Rotation.from_euler("y", -q[1]), Rotation.from_euler("y", -q[2])
            after_elbow = np.array([0.4, 0.0, 0.0]) + elbow.apply([0.3, 0.0, 0.0])
            expected = np.array([0.0, 0.0, 0.2]) + base.apply(shoulder.apply(after_elbow))
            assert tip == pytest.approx(expected, abs=1e-12)

    def test_positions_of_its_tip_have_one_inverse(self) -> None:
        """The closed form of the textbooks, with the elbow on the box's side."""
        arm = ElbowArm()
        q = inside(arm, 200)
        x, y, z = arm.inputs(q).T
        reach, rise = np.hypot(x, y), z - arm.height
        a, b = arm.upper_arm, arm.forearm
        elbow = -np.arccos((reach**2 + rise**2 - a**2 - b**2) / (2.0 * a * b))
        shoulder = np.arctan2(rise, reach) - np.arctan2(b * np.sin(elbow), a + b * np.cos(elbow))
        found = np.column_stack([np.arctan2(y, x), shoulder, elbow])
        assert found == pytest.approx(q, abs=1e-9)

    def test_its_tip_stays_off_the_axis_of_the_base(self) -> None:
        arm = ElbowArm()
        tips = arm.inputs(inside(arm, 500))
        assert np.hypot(tips[:, 0], tips[:, 1]).min() > 0.2

    def test_the_error_is_the_tips_in_millimetres(self) -> None:
        """A milliradian of the base at a reach of r is r mm."""
        arm = ElbowArm()
        q = inside(arm)
        tips = arm.inputs(q)
        errors = arm.errors(q, q + np.array([1e-3, 0.0, 0.0]))
        assert errors == pytest.approx(np.hypot(tips[:, 0], tips[:, 1]), rel=1e-6)


class TestInverseKinematicsOfTheGantry:
    def test_inputs_are_the_task_coordinates(self, gantry: Robot) -> None:
        """Eq. (1)-(2), as the gantry computes them before they are made a pose."""
        system = RobotSystem(gantry)
        q = inside(system)
        kinematics = gantry.forward_kinematics
        assert isinstance(kinematics, GantryKinematics)
        assert system.inputs(q) == pytest.approx(kinematics.task_coordinates(q), abs=1e-9)

    def test_on_the_gimbal_edge_they_are_the_examples_own(self, gantry: Robot) -> None:
        """There many pairs of roll and yaw are one orientation; to a micro-radian of tilt."""
        system = RobotSystem(gantry)
        q = inside(system)
        kinematics = gantry.forward_kinematics
        assert isinstance(kinematics, GantryKinematics)
        q[:, 4] = gantry.joint_box.upper[4]
        task = kinematics.task_coordinates(q)
        assert task[:, 4] == pytest.approx(np.full(20, 0.5 * np.pi))
        assert system.inputs(q) == pytest.approx(task, abs=1e-6)

    def test_the_error_is_the_end_effectors_in_millimetres(self, gantry: Robot) -> None:
        """Half a degree of the x drive is 5 mm, eq. (13); turning moves it nowhere."""
        system = RobotSystem(gantry)
        q = inside(system)
        along_x = system.errors(q, q + np.radians([0.5, 0, 0, 0, 0, 0]))
        assert along_x == pytest.approx(np.full(20, 5.0))
        turned = system.errors(q, q + np.radians([0, 0, 0, 0.5, 0.5, 0.5]))
        assert turned == pytest.approx(np.zeros(20), abs=1e-9)


@pytest.mark.parametrize("set_name", ["set1", "set2"])
def test_features_of_the_gantry_are_those_that_its_networks_see(set_name: str) -> None:
    """At a pitch of 90 degrees too, where roll and yaw are those of the example."""
    system = RobotSystem(paper_robot())
    joint_positions = robot_set("thirty_phase", set_name)
    trained = InverseKinematicsSystem(system.robot).inputs(joint_positions)
    assert np.allclose(system.inputs(joint_positions), trained, rtol=0.0, atol=1e-14)
