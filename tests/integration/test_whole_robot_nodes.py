"""A whole robot over DDS: its branch is followed, its end is refused, all solutions are given."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import Transition
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from msg_tools.conversions.joint_state import joint_state_from_array, joint_state_to_array
from msg_tools.conversions.stamp import stamp_from_nanoseconds

WHOLE_ROBOT = ("-p", "model:=ur5e", "-p", "mode:=whole_robot", "-p", "queue_depth:=100")
#: One of the branches of the UR5e through the middle of its box, which end at x = 0.64 m.
ENDING = np.array([0.0, -0.899, 0.942, -4.581, 1.571, -3.142])
STEP = 0.005


@pytest.fixture(scope="module")
def solver() -> IkSolver:
    return IkSolver(load_model("ur5e"), mode=SolverMode.WHOLE_ROBOT)


def _pose(solver: IkSolver, joint_positions: FloatArray) -> FloatArray:
    return solver.robot.forward_kinematics.poses(joint_positions[np.newaxis])[0]


def _moved(pose: FloatArray, steps: int) -> FloatArray:
    moved = pose.copy()
    moved[0] += steps * STEP
    return moved


def _commands(client: Any, solver: IkSolver, pose: FloatArray) -> list[FloatArray]:
    """The commands that a target was answered by."""
    by_stamp = dict(
        zip(client.stamps("joint_command"), client.received["joint_command"], strict=True)
    )
    names = solver.robot.joint_names
    return [joint_state_to_array(by_stamp[stamp], names) for stamp in client.stamps_of(pose)]


def test_a_branch_is_followed_from_where_the_robot_is_until_it_ends(
    launch: Callable[..., Any], client: Any, solver: IkSolver
) -> None:
    """Its end is refused with the way to the nearest other solution, which may then be allowed."""
    robot, start = solver.robot, _pose(solver, ENDING)
    launch("ik_node", *WHOLE_ROBOT, ready=False)
    client.connect(start)
    # Nobody says where the robot is: a function of the pose alone.
    (first, *_) = _commands(client, solver, start)
    assert np.array_equal(first, solver.solve(start).joint_positions)
    assert np.abs(first - ENDING).max() > 1.0

    launch("fake_robot", "-p", "model:=ur5e", ready=False)
    client.repeat_until(
        lambda: client.command.publish(
            joint_state_from_array(ENDING, robot.joint_names, stamp_from_nanoseconds(1))
        ),
        lambda: 1 in client.stamps("achieved_pose"),
        "the robot on another branch",
    )
    client.wait_for_status(
        "ik_node", lambda values: values["measured joint positions"] == "known", "the robot"
    )
    for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE):
        assert client.change_state("ik_node", transition)
    previous, steps = ENDING, 0
    path = [_moved(start, step) for step in range(1, 25)]
    for target in path:
        client.send(target)
    client.wait_for_status(
        "ik_node", lambda values: values.get("refused: branch ends"), "the end of the branch"
    )
    client.take_the_rest()
    for target in path:
        if not client.stamps_of(target):
            break
        (command,) = _commands(client, solver, target)
        # Dense enough for a step to be small, although it grows towards a singularity.
        assert np.abs(command - previous).max() < 0.2
        previous, steps = command, steps + 1
    assert start[0] + steps * STEP == pytest.approx(0.638, abs=STEP)
    refused = len(path) - steps
    _, values = client.wait_for_status(
        "ik_node", lambda values: values["targets refused"] == str(refused), "all refusals"
    )
    assert values["refused: branch ends"] == values["targets refused"]

    beyond = _moved(start, steps + 1)
    others = [one.joint_positions for one in solver.solutions(beyond, previous)]
    nearest = min(np.abs(other - previous).max() for other in others)
    client.send(beyond)
    _, values = client.wait_for_status(
        "ik_node",
        lambda values: values["refused: branch ends"] == str(refused + 1),
        "the refusal of one target",
    )
    (distance,) = re.findall(r"another branch is (\S+) away", values["last refusal"])
    assert float(distance) == pytest.approx(nearest, rel=1e-3)

    assert client.set_parameter("ik_node", "allow_branch_change", True).successful
    client.send(beyond)
    client.wait_for_results(beyond, ["joint_command", "tracking_error/position"])
    (changed,) = _commands(client, solver, beyond)
    assert np.abs(changed - previous).max() == pytest.approx(nearest, abs=1e-6)
    assert np.abs(_pose(solver, changed) - beyond).max() < 1e-6


def test_all_solutions_are_given_on_request_and_the_robot_stays(
    launch: Callable[..., Any], client: Any, solver: IkSolver
) -> None:
    """Nearest to the robot first, with the stamp of the request; none for what has none."""
    robot, target = solver.robot, _pose(solver, ENDING)
    launch("ik_node", *WHOLE_ROBOT, ready=False)
    requests = client.node.create_publisher(PoseStamped, "solutions_target", 10)
    client.listen("solutions", JointTrajectory)

    def answer(pose: FloatArray, stamp: int, frame: str = "") -> FloatArray:
        message = client.pose_stamped(pose, stamp, frame)
        client.repeat_until(
            lambda: requests.publish(message),
            lambda: stamp in client.stamps("solutions"),
            "an answer with the stamp of the request",
            pause=2.0,
        )
        (*_, found) = client.received["solutions"]
        assert tuple(found.joint_names) == robot.joint_names
        return np.array([point.positions for point in found.points]).reshape(-1, robot.dof)

    alone = answer(target, 1)
    assert len(alone) == 8
    for joint_positions in alone:
        assert np.abs(_pose(solver, joint_positions) - target).max() < 1e-6
        assert robot.joint_limits.violation(joint_positions) is None
    assert answer(target, 2, robot.base_frame).tolist() == alone.tolist()
    assert not len(answer(target, 3, "elsewhere"))
    assert not len(answer(_moved(target, 1000), 4))

    states = client.node.create_publisher(JointState, "joint_states", 10)
    client.repeat_until(
        lambda: states.publish(joint_state_from_array(ENDING, robot.joint_names)),
        lambda: (
            np.abs(answer(target, 5 + len(client.received["solutions"]))[0] - ENDING).max() < 1e-2
        ),
        "the solution where the robot is",
    )
    assert client.set_parameter("ik_node", "solution_turns", True).successful
    turned = answer(target, 1000)
    turns = (turned[:, np.newaxis] - alone) / (2.0 * np.pi)
    of = np.abs(turns - np.round(turns)).max(axis=2).argmin(axis=1)
    assert set(of) == set(range(8))
    assert len(turned) == len(np.unique(turned.round(6), axis=0)) > 100
    _, values = client.wait_for_status(
        "ik_node", lambda values: int(values["solutions found"]) > 100, "the counts"
    )
    assert int(values["solutions requested"]) >= len(client.received["solutions"])
    assert not client.received["joint_command"]
