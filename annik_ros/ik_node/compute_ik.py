"""The service of MoveIt for inverse kinematics, where its messages are installed."""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rclpy.serialization import serialize_message

from annik_core.errors import AnnikError
from annik_core.safety import IkStatus, Refusal
from annik_ros.ik_node.frames import NoTransform
from msg_tools.conversions.cdr import StampedPoses
from msg_tools.conversions.joint_state import joint_state_from_array, joint_state_to_array

if TYPE_CHECKING:
    from annik_core.serving.ik_server import IkServer


def service_type() -> Any:
    """``GetPositionIK``, or None without moveit_msgs."""
    try:
        return import_module("moveit_msgs.srv").GetPositionIK
    except ImportError:
        return None


def compute_ik(
    server: "IkServer | None",
    in_base_frame: Callable[[bytes], StampedPoses],
    request: Any,
    response: Any,
) -> Any:
    """Fill in the response: the solution nearest to the robot state of the request.

    Without one, nearest to where the robot is. ``server``: None while the node is not active.
    """
    wanted, error = request.ik_request, response.error_code
    if server is None:
        error.val = error.FAILURE
        return response
    robot = server.solver.robot
    if wanted.ik_link_name not in ("", robot.end_effector_frame):
        error.val = error.INVALID_LINK_NAME
        return response
    state, near = wanted.robot_state.joint_state, None
    try:
        if state.name:
            near = joint_state_to_array(state, robot.joint_names)
        target = in_base_frame(serialize_message(wanted.pose_stamped))
    except NoTransform:
        error.val = error.FRAME_TRANSFORM_FAILURE
        return response
    except AnnikError:
        error.val = error.INVALID_ROBOT_STATE
        return response
    found = server.solutions(target.poses[0], target.frame_id, near)
    if isinstance(found, Refusal):
        frame = found.status is IkStatus.WRONG_FRAME
        error.val = error.FRAME_TRANSFORM_FAILURE if frame else error.NO_IK_SOLUTION
    elif not found or (positions := found[0].joint_positions) is None:
        error.val = error.NO_IK_SOLUTION
    else:
        response.solution.joint_state = joint_state_from_array(positions, robot.joint_names)
        error.val = error.SUCCESS
    return response
