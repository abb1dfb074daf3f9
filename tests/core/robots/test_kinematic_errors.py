"""The geometric errors of an arm: what each one does to its chain. ROS-free."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm
from support.urdf_texts import J1, joint, planar_arm, urdf

from annik_core.robots.corrections import ArmCorrections
from annik_core.robots.kinematic_errors import (
    ErrorKind,
    GeometricError,
    geometric_errors,
    placements_of,
)
from annik_core.robots.library import load_robot, packaged_robots, robot_from_definition
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain

ARMS = tuple(name for name in packaged_robots() if name != "gantry")
PRISMATIC = urdf("abc", J1, joint("j2", "b", "c", "prismatic", limit='lower="-0.5" upper="0.2"'))
J3 = joint("j3", "c", "d")
SKEWED = urdf("abcd", J1, joint("j2", "b", "c"), joint("j3", "c", "d", axis='xyz="0.2 -0.5 0.7"'))


@cache
def robot_of(source: str) -> Robot:
    return load_robot(source)


def errors_of(source: str) -> tuple[GeometricError, ...]:
    return geometric_errors(robot_of(source))


@pytest.fixture(params=[*ARMS, PRISMATIC, SKEWED, planar_arm()])
def source(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_each_has_a_name_of_its_own(source: str) -> None:
    errors = errors_of(source)
    assert len({error.name for error in errors}) == len(errors)


def test_are_four_a_joint_and_what_these_can_not_say(source: str) -> None:
    """Alignments: four of the base, one a link, and for the end effector a sixth direction."""
    robot, errors = robot_of(source), errors_of(source)
    kinds = [error.kind for error in errors]
    denavit_hartenberg = {"JOINT_ZERO", "JOINT_OFFSET", "LINK_LENGTH", "LINK_TWIST"}
    assert sum(kind.name in denavit_hartenberg for kind in kinds) == 4 * robot.dof
    assert kinds.count(ErrorKind.ALIGNMENT_OF_BASE) == 4
    assert kinds.count(ErrorKind.LINK_ALIGNMENT) == robot.dof - 1
    assert kinds.count(ErrorKind.TOOL_ALIGNMENT) == 2
    assert [error.place for error in errors] == sorted(error.place for error in errors)
    for error in errors:
        named = robot.joint_names[max(error.place - 1, 0)]
        assert named in error.name


def test_directions_are_unit_vectors_and_motions_are_rigid(source: str) -> None:
    for error in errors_of(source):
        assert np.linalg.norm(error.direction) == pytest.approx(1.0, abs=1e-12)
        motion = error.motion(0.3)
        assert motion[:3, :3] @ motion[:3, :3].T == pytest.approx(np.eye(3), abs=1e-14)
        assert np.linalg.det(motion[:3, :3]) == pytest.approx(1.0)
        assert motion @ error.motion(-0.3) == pytest.approx(np.eye(4), abs=1e-14)


def test_a_motion_is_the_exponential_of_its_screw(source: str) -> None:
    for error in errors_of(source):
        screw = np.zeros((4, 4))
        if error.is_rotation:
            x, y, z = error.direction
            screw[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
            screw[:3, 3] = -screw[:3, :3] @ error.point
        else:
            screw[:3, 3] = error.direction
        assert error.motion(0.2) == pytest.approx(expm(0.2 * screw), abs=1e-13)


def test_the_common_normal_is_at_right_angles_to_both_axes(source: str) -> None:
    """And meets both: at its foot this axis, along itself the next one."""
    chain = ScrewChain.from_urdf(robot_of(source).definition["urdf"])
    dof = len(chain.axes)
    for error in errors_of(source):
        if error.kind is not ErrorKind.LINK_TWIST or error.place == dof:
            continue
        axes = [row[3:] if np.any(row[3:]) else row[:3] for row in chain.axes]
        axis, placement = axes[error.place - 1], chain.placements[error.place]
        following = placement[:3, :3] @ axes[error.place]
        assert error.direction @ axis == pytest.approx(0.0, abs=1e-9)
        assert error.direction @ following == pytest.approx(0.0, abs=1e-9)
        assert np.cross(error.point, axis) == pytest.approx(np.zeros(3), abs=1e-12)
        # From the foot to the next axis there is nothing but a way along the normal.
        gap = placement[:3, 3] - error.point
        across = np.cross(np.cross(gap, following), error.direction)
        volume = np.linalg.det(np.stack([gap, following, error.direction]))
        assert volume == pytest.approx(0.0, abs=1e-9), across


def test_placements_are_the_errors_one_after_the_other(source: str) -> None:
    robot, errors = robot_of(source), errors_of(source)
    rng = np.random.default_rng(3)
    amounts = rng.normal(size=len(errors)) * 1e-2
    placements = placements_of(errors, amounts, robot.dof)
    corrections = ArmCorrections(placements)
    definition = {**robot.definition, "corrections": corrections.to_dict()}
    corrected = robot_from_definition(definition, "x").forward_kinematics
    chain = ScrewChain.from_urdf(robot.definition["urdf"])
    for joint_positions in robot.joint_box.sample(3, rng):
        matrix = np.eye(4)
        for place in range(robot.dof + 1):
            if place:
                linear, angular = np.split(chain.axes[place - 1], 2)
                x, y, z = angular
                screw = np.zeros((4, 4))
                screw[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
                screw[:3, 3] = linear
                matrix = matrix @ chain.placements[place - 1]
                matrix = matrix @ expm(joint_positions[place - 1] * screw)
            for error, amount in zip(errors, amounts, strict=True):
                if error.place == place:
                    matrix = matrix @ error.motion(float(amount))
        matrix = matrix @ chain.placements[-1]
        (pose,) = corrected.poses(joint_positions[np.newaxis])
        assert pose[:3] == pytest.approx(matrix[:3, 3], abs=1e-12)


def test_nothing_wrong_is_no_motion(source: str) -> None:
    robot, errors = robot_of(source), errors_of(source)
    placements = placements_of(errors, np.zeros(len(errors)), robot.dof)
    assert np.array_equal(placements, [[0, 0, 0, 0, 0, 0, 1]] * (robot.dof + 1))


@pytest.mark.parametrize("half_turn", ["3.1416", "3.14159", "3.141592653589793"])
def test_axes_that_are_parallel_but_for_rounding_count_as_parallel(half_turn: str) -> None:
    """Where their lines really come nearest, kilometres away, nothing is to turn about."""
    origin = f'xyz="0 -0.41 0.1" rpy="{half_turn} 0 0"'
    arm = urdf("abcd", joint("j1", "a", "b", origin=""), joint("j2", "b", "c", origin=origin), J3)
    twist, length = (
        next(error for error in errors_of(arm) if error.kind is kind and error.place == 1)
        for kind in (ErrorKind.LINK_TWIST, ErrorKind.LINK_LENGTH)
    )
    assert np.linalg.norm(twist.point) < 1.0
    assert np.abs(length.direction) == pytest.approx([0.0, 1.0, 0.0], abs=1e-4)
