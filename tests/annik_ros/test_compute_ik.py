"""MoveIt's service, with stand-ins for its messages, which are not on the package index."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from annik_core.pose import FloatArray
from annik_core.robots.library import load_robot
from annik_core.serving.ik_server import IkServer
from annik_view.solvers import solver_for

pytest.importorskip("rclpy")

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from annik_ros.ik_node.compute_ik import compute_ik, service_type
from annik_ros.ik_node.frames import NoTransform
from msg_tools.conversions.cdr import StampedPoses, pose_stamped_from_bytes
from msg_tools.conversions.joint_state import joint_state_from_array
from msg_tools.conversions.pose import pose_from_array

CODES = {
    "SUCCESS": 1,
    "FAILURE": 99999,
    "INVALID_ROBOT_STATE": -17,
    "INVALID_LINK_NAME": -18,
    "FRAME_TRANSFORM_FAILURE": -21,
    "NO_IK_SOLUTION": -31,
}
HOME = np.array([0.1, -1.2, 1.5, -1.8, -1.5, 0.3])


@pytest.fixture(scope="module")
def server() -> IkServer:
    return IkServer(solver_for(load_robot("ur5e")))


def target(server: IkServer) -> FloatArray:
    pose: FloatArray = server.solver.robot.forward_kinematics.poses(HOME[np.newaxis])[0]
    return pose


def answered(
    server: IkServer | None,
    pose: FloatArray,
    state: JointState | None = None,
    link: str = "",
    frame: str = "",
    in_base_frame: Any = pose_stamped_from_bytes,
) -> tuple[int, JointState]:
    stamped = PoseStamped(pose=pose_from_array(pose))
    stamped.header.frame_id = frame
    wanted = SimpleNamespace(
        ik_link_name=link,
        pose_stamped=stamped,
        robot_state=SimpleNamespace(joint_state=state or JointState()),
    )
    response = SimpleNamespace(
        solution=SimpleNamespace(joint_state=None),
        error_code=SimpleNamespace(val=0, **CODES),
    )
    found = compute_ik(server, in_base_frame, SimpleNamespace(ik_request=wanted), response)
    return found.error_code.val, found.solution.joint_state


def test_it_is_there_where_its_messages_are(monkeypatch: pytest.MonkeyPatch) -> None:
    fake = ModuleType("moveit_msgs.srv")
    fake.GetPositionIK = object()  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "moveit_msgs", ModuleType("moveit_msgs"))
    monkeypatch.setitem(sys.modules, "moveit_msgs.srv", fake)
    assert service_type() is fake.GetPositionIK
    monkeypatch.setitem(sys.modules, "moveit_msgs.srv", None)
    assert service_type() is None


def test_the_solution_is_the_nearest_to_the_state_of_the_request(server: IkServer) -> None:
    robot, pose = server.solver.robot, target(server)
    for solution in server.solver.solutions(pose):
        state = joint_state_from_array(solution.joint_positions + 0.01, robot.joint_names)
        code, found = answered(server, pose, state, robot.end_effector_frame, robot.base_frame)
        assert code == CODES["SUCCESS"]
        assert list(found.name) == list(robot.joint_names)
        assert np.abs(found.position - solution.joint_positions).max() < 1e-6
    code, found = answered(server, pose)
    assert code == CODES["SUCCESS"]
    reached = robot.forward_kinematics.poses(np.array([found.position]))[0]
    assert np.abs(reached - pose).max() < 1e-6


def test_what_can_not_be_answered_has_its_code(server: IkServer) -> None:
    def no_transform(_: bytes) -> StampedPoses:
        raise NoTransform("none")

    pose = target(server)
    far = pose + np.array([9.0, 0, 0, 0, 0, 0, 0])
    partial = JointState(name=["elbow_joint"], position=[0.0])
    for expected, code in (
        ("FAILURE", answered(None, pose)),
        ("INVALID_LINK_NAME", answered(server, pose, link="elbow")),
        ("INVALID_ROBOT_STATE", answered(server, pose, partial)),
        ("FRAME_TRANSFORM_FAILURE", answered(server, pose, frame="elsewhere")),
        ("FRAME_TRANSFORM_FAILURE", answered(server, pose, in_base_frame=no_transform)),
        ("NO_IK_SOLUTION", answered(server, far)),
    ):
        assert code[0] == CODES[expected], expected
