"""Arms that can't reach every pose: what is reached, and what rotation is left over. ROS-free."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from support.urdf_texts import joint, urdf

from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.robots.robot import Robot
from annik_core.robots.task import Task
from annik_core.safety import Candidate, IkStatus
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_core.solver.search import SearchOptions
from annik_core.solver.whole_robot import WholeRobot


@pytest.fixture(scope="module")
def five() -> Robot:
    return hobby_arm(2.0)


def hobby_arm(limit: float) -> Robot:
    """Base, shoulder, elbow, wrist and roll, each within ``limit`` [rad] of the middle."""
    axes = {"pan": "0 0 1", "lift": "0 1 0", "elbow": "0 1 0", "wrist": "0 1 0", "roll": "1 0 0"}
    offsets = ["0 0 0.1", "0 0 0.05", "0.12 0 0", "0.13 0 0", "0.06 0 0"]
    links = ["base", "a", "b", "c", "d", "e", "tip"]
    joints = [
        joint(
            name,
            *links[at : at + 2],
            axis=f'xyz="{axis}"',
            origin=f'xyz="{offset}"',
            limit=f'lower="{-limit}" upper="{limit}"',
        )
        for at, ((name, axis), offset) in enumerate(zip(axes.items(), offsets, strict=True))
    ]
    return load_robot(
        urdf(links, *joints, joint("tool", "e", "tip", "fixed", origin='xyz="0.05 0 0"'))
    )


def whole(robot: Robot, task: Task = Task.AUTO) -> WholeRobot:
    return WholeRobot(robot, options=SearchOptions(task=task))


def solved(solver: WholeRobot, pose: FloatArray) -> Candidate:
    return solver.preferred(pose, np.empty((0, solver.robot.dof)))


def pose_at(robot: Robot, joint_positions: FloatArray) -> FloatArray:
    return robot.forward_kinematics.poses(np.asarray(joint_positions)[np.newaxis])[0]


def turned(pose: FloatArray, rotation: Rotation) -> FloatArray:
    """The pose with its orientation turned about the axes of the base."""
    return np.concatenate([pose[:3], (rotation * Rotation.from_quat(pose[3:])).as_quat()])


@pytest.mark.parametrize(
    ("name", "task"), [("ur5e", Task.POSE), ("panda", Task.POSE), ("scara", Task.POSITION)]
)
def test_it_is_chosen_by_the_directions_in_which_the_arm_moves(name: str, task: Task) -> None:
    assert Task.AUTO.of(load_robot(name)) is task
    assert Task.POSITION_AND_AXIS.of(load_robot(name)) is Task.POSITION_AND_AXIS


def test_what_the_arm_reaches_is_reached(five: Robot) -> None:
    solver = whole(five)
    for positions in five.joint_box.sample(50, np.random.default_rng(2)):
        candidate = solved(solver, pose_at(five, positions))
        assert candidate.converged
        assert max(candidate.residuals()) < 1e-6


def test_otherwise_the_rotation_left_over_is_the_least_there_is(five: Robot) -> None:
    """Compared with SciPy's minimum of the angle, the position held, from many starts."""
    solver, rng = whole(five), np.random.default_rng(5)
    bounds = list(zip(five.joint_limits.lower, five.joint_limits.upper, strict=True))
    for positions in five.joint_box.sample(4, rng):
        positions *= 0.7
        pose = turned(pose_at(five, positions), Rotation.from_rotvec([0.3, -0.2, 0.4]))
        candidate = solved(solver, pose)
        assert candidate.converged and five.joint_limits.contains(candidate.joint_positions)
        distance, angle = candidate.residuals()
        assert distance < 1e-6 and angle > 1e-3

        def left_over(q: FloatArray, pose: FloatArray = pose) -> float:
            return five.forward_kinematics.residuals(q, pose)[1] ** 2

        def shift(q: FloatArray, pose: FloatArray = pose) -> FloatArray:
            return 10.0 * (pose_at(five, q)[:3] - pose[:3])

        found = [
            minimize(left_over, start, bounds=bounds, constraints={"type": "eq", "fun": shift})
            for start in [positions, *five.joint_box.sample(4, rng)]
        ]
        least = min(math.sqrt(one.fun) for one in found if one.success)
        # Less where two branches meet, near which a minimum is flat.
        assert angle <= least + 0.01


def test_the_axis_is_reached_where_that_is_the_task() -> None:
    scara = load_robot("scara")
    solver = whole(scara, Task.POSITION_AND_AXIS)
    upright = pose_at(scara, scara.joint_box.centre)
    assert solved(solver, upright).converged
    assert not solved(solver, turned(upright, Rotation.from_rotvec([0.2, 0.0, 0.0]))).converged


def test_a_path_is_followed_without_a_jump(five: Robot) -> None:
    solver = whole(five)
    previous = np.array([0.1, -0.6, 1.2, 0.4, 0.2])
    start = pose_at(five, previous)
    for part in np.linspace(0.0, 1.0, 30)[1:]:
        pose = turned(start, Rotation.from_rotvec([0.5 * part, 0.3 * part, -0.4 * part]))
        pose[:3] += part * np.array([0.02, 0.04, -0.03])
        candidate = solver.continued(pose, previous, lambda: np.empty((0, 5)))
        assert candidate.converged and not candidate.branch_end
        assert candidate.residuals()[0] < 1e-6
        assert np.abs(candidate.joint_positions - previous).max() < 0.06
        previous = candidate.joint_positions
    assert candidate.residuals()[1] > 0.01


def test_the_solver_says_what_is_left_over_and_refuses_if_the_pose_is_the_task() -> None:
    model = load_model("scara")
    pose = pose_at(model.robot, model.robot.joint_box.centre + 0.1)
    tilted = turned(pose, Rotation.from_rotvec([0.1, 0.0, 0.0]))
    solver = IkSolver(model, mode=SolverMode.WHOLE_ROBOT)
    result = solver.solve(tilted)
    assert result.accepted
    assert result.orientation_residual == pytest.approx(0.1, abs=1e-6)
    (first, *_) = solver.solutions(tilted)
    assert first.orientation_residual == pytest.approx(0.1, abs=1e-6)
    strict = IkSolver(
        model, mode=SolverMode.WHOLE_ROBOT, search_options=SearchOptions(task=Task.POSE)
    )
    assert strict.solve(tilted).status is IkStatus.NOT_CONVERGED
    assert strict.solutions(tilted) == []


def test_a_full_turn_makes_no_other_solution() -> None:
    robot = hobby_arm(math.pi)
    backwards = np.array([math.pi, 0.5, 0.6, 0.7, 0.0])
    pose = turned(pose_at(robot, backwards), Rotation.from_rotvec([0.0, 0.0, 1e-3]))
    candidates = whole(robot).every(pose, np.empty((0, 5)), backwards, turns=False)
    found = np.array([candidate.joint_positions for candidate in candidates])
    for row, one in enumerate(found):
        assert (np.abs(found[:row] - one).max(axis=1, initial=0.0) > 1e-3).all()
