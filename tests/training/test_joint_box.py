"""What a joint box leaves open is told before training: all of it, with the joints. ROS-free."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.urdf_texts import joint, planar_arm, urdf

from annik_core.robots.arm import arm_from_definition
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_training.designs.registry import random_dataset
from annik_training.fitting.branches import single_branch
from annik_training.joint_box import findings, mobility

SHARED = Path(__file__).parents[3] / "shared" / "robots"


def boxed(robot: Robot) -> Robot:
    """The robot in a joint box as wide as its limits, but for a hair."""
    box, kind = robot.joint_box, np.array(robot.joint_types)
    joint = int(np.argmin(kind == "continuous"))
    lower, upper = box.lower[joint] + 1e-6, box.upper[joint] - 1e-6
    name = robot.joint_names[joint]
    definition = dict(robot.definition)
    definition["joint_box"] = {**definition["joint_box"], name: [float(lower), float(upper)]}
    return arm_from_definition(definition, "test")


WRIST = {"roll": "1 0 0", "pitch": "0 1 0", "yaw": "0 0 1"}


def telescopes(second: str = "1 0 0", stroke: str = 'lower="0" upper="0.5"') -> Robot:
    """A lift, two telescopes along x, and a wrist that turns every way."""
    slides = {"lift": "0 0 1", "first": "1 0 0", "second": second}
    axes = {**slides, **WRIST}
    links = [f"l{number}" for number in range(len(axes) + 1)]
    joints = [
        joint(
            name,
            links[number],
            links[number + 1],
            "prismatic" if name in slides else "revolute",
            origin='xyz="0.1 0 0"',
            axis=f'xyz="{axis}"',
            limit=stroke if name in slides else 'lower="-1" upper="1.2"',
        )
        for number, (name, axis) in enumerate(axes.items())
    ]
    return load_robot(urdf(links, *joints))


class TestMobility:
    """The rank of the Jacobian, for any number of joints."""

    @pytest.mark.parametrize("second", ["1 0 0", "-1 0 0", "1 0 0.00001"])
    def test_parallel_telescopes_are_redundant(self, second: str) -> None:
        """Six joints, and a determinant that is nothing but rounding."""
        robot = telescopes(second)
        sample = robot.joint_box.sample(50, np.random.default_rng(0))
        determinants = np.linalg.det(robot.forward_kinematics.jacobians(sample))
        assert np.abs(determinants).max() < 1e-4
        moves = mobility(robot)
        assert (moves.dimensions, len(moves.locks)) == (5, 1)
        assert moves.redundant == ["first", "second"]
        assert moves.locks[0] in (1, 2)

    def test_crossed_telescopes_are_not(self) -> None:
        moves = mobility(telescopes("0 1 0"))
        assert (moves.dimensions, moves.redundant, moves.locks) == (6, [], [])

    @pytest.mark.parametrize(
        ("name", "dimensions"), [("scara", 4), ("panda", 6), ("ur5e", 6), ("gantry", 6)]
    )
    def test_of_packaged_robots(self, name: str, dimensions: int) -> None:
        """The panda's box locks a joint."""
        moves = mobility(load_robot(name))
        assert (moves.dimensions, moves.redundant) == (dimensions, [])

    def test_of_seven_joints(self) -> None:
        robot = load_robot("panda", joint_box={"panda_joint3": [-0.5, 0.5]})
        assert mobility(robot).redundant == list(robot.joint_names)

    def test_examples_of_a_redundant_arm_are_all_kept(self) -> None:
        """The signs of its determinants mean nothing."""
        robot = telescopes()
        dataset = random_dataset(robot, robot.joint_box, 20, seed=0)
        assert single_branch(robot, dataset.joint_positions, dataset.poses).all()


class TestFindings:
    """All at once, each with the joints and the remedy."""

    def test_redundancy_full_turns_and_branches_together(self) -> None:
        robot = load_robot(
            "panda", joint_box={"panda_joint3": [-0.5, 0.5], "panda_joint7": [-2.897, 2.897]}
        )
        redundant, *others = findings(robot)
        assert "7 joints move" in redundant
        assert re.search(
            r"Lock 1 of .*panda_joint7, such as --joint-box panda_joint\d=", redundant
        )
        assert "branch" in others[-1]
        wide = load_robot(planar_arm().replace('"3"', '"3.1416"').replace('"-3"', '"-3.1416"'))
        dimensions, turns, branches = findings(boxed(wide))
        assert "shoulder, elbow, wrist" in turns
        assert "full turn" in turns
        assert "3 joints move: poses in 3 dimensions only" in dimensions
        assert "two branches" in branches

    @pytest.mark.parametrize(
        ("lower", "upper", "percent"), [(-1.0, 1.0, 50.0), (-0.5, 1.5, 25.0), (-0.2, 1.8, 10.0)]
    )
    def test_the_joint_that_causes_two_branches_is_named(
        self, lower: float, upper: float, percent: float
    ) -> None:
        """Of an arm with three joints, whose Jacobian has no determinant."""
        robot = load_robot(planar_arm(), joint_box={"elbow": [lower, upper]})
        text = findings(robot)[-1]
        told = re.search(
            r"([\d.]+) % of the joint box are beyond .* crossed by (.*)\. Poses", text
        )
        assert told is not None
        assert float(told[1]) == pytest.approx(percent, abs=5.0)
        assert told[2] == "elbow (at 0)"

    @pytest.mark.parametrize("box", [[0.1, 2.0], [-2.0, -0.1], [0.5, 0.5]])
    def test_a_box_on_one_side_of_it_is_one_branch(self, box: list[float]) -> None:
        text = findings(load_robot(planar_arm(), joint_box={"elbow": box}))[-1]
        assert text.startswith("one branch: no singularity")

    def test_the_joints_of_six(self) -> None:
        text = findings(load_robot("ur5e"))[-1]
        assert re.search(r"two branches or more: [45]\.\d % .* crossed by shoulder_lift", text)
        assert findings(load_robot("puma560"))[-1].startswith("one branch")

    def test_limits_that_look_like_other_units(self) -> None:
        text = planar_arm().replace('lower="-3" upper="3"', 'lower="-170" upper="170"', 1)
        odd = findings(load_robot(text))[0]
        assert "degrees" in odd
        assert odd.endswith(": shoulder")
        robot = telescopes("0 1 0", stroke='lower="0" upper="500"')
        assert "millimetres" in findings(robot)[0]
        assert findings(robot)[0].endswith(": lift, first, second")
        assert not any("limits" in line for line in findings(load_robot("ur5e")))

    def test_two_full_turns_to_either_side_are_usual(self) -> None:
        limit = f'lower="{-4 * math.pi!r}" upper="{4 * math.pi!r}"'
        text = planar_arm().replace('lower="-3" upper="3"', limit)
        assert not any("degrees" in line for line in findings(load_robot(text)))

    def test_of_a_whole_robot_no_box_is_asked_for(self) -> None:
        """Redundant or of few joints: nothing is to be locked or made smaller."""
        for robot in (telescopes(), load_robot(planar_arm())):
            assert robot.has_whole_box
            told = findings(robot)
            assert not any("--joint-box" in line or "Lock" in line for line in told)
            assert told[-1].startswith("whole robot: ")
        assert "infinitely many" in findings(telescopes())[0]
        assert "3 dimensions only" in findings(load_robot(planar_arm()))[0]

    def test_of_the_gantry(self, gantry: Robot) -> None:
        assert len(findings(gantry)) == 1


@pytest.mark.skipif(not SHARED.is_dir(), reason="../shared/robots is not beside this checkout")
class TestSharedRobots:
    """Arms of other makers, of which the findings are known."""

    @staticmethod
    def told(name: str, **joint_box: list[float]) -> str:
        rows = {row["name"]: row for row in csv.DictReader((SHARED / "index.csv").open())}
        frames = {key: rows[name][key] for key in ("base_frame", "end_effector_frame")}
        robot = load_robot(SHARED / f"{name}.urdf", **frames, joint_box=joint_box or None)
        return "\n".join(findings(boxed(robot)))

    def test_stretch3(self) -> None:
        assert "Lock 3 of joint_arm_l3, joint_arm_l2, joint_arm_l1, joint_arm_l0," in self.told(
            "stretch3"
        )
        two = {"joint_arm_l0": [0.05, 0.05], "joint_arm_l1": [0.05, 0.05]}
        assert "Lock 1 of joint_arm_l3, joint_arm_l2," in self.told("stretch3", **two)

    def test_tiago_torso(self) -> None:
        assert "Lock 2 of torso_lift_joint, arm_1_joint" in self.told("tiago_torso")

    @pytest.mark.parametrize(
        ("name", "joint"),
        [
            ("so101", "elbow_flex (at -1.2"),
            ("kuka_kr210", "joint_a5 (at 0)"),
            ("ar4", "joint_5 ("),
        ],
    )
    def test_branches(self, name: str, joint: str) -> None:
        assert joint in self.told(name)
