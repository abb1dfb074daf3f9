"""When ``ik_node`` refuses a target, in the order of the checks; for the documentation."""

from annik_core.pose import QUATERNION_NORM_TOLERANCE
from annik_core.safety import IkStatus

REFUSALS = {
    IkStatus.NOT_ACTIVE: "the node is configured, but not active",
    IkStatus.MALFORMED_MESSAGE: (
        "the bytes are not those of a message of this type, or its stamp has a second or more "
        "of nanoseconds"
    ),
    IkStatus.WRONG_FRAME: (
        "frame_id is neither empty nor the base frame, and tf2 has no transform to that"
    ),
    IkStatus.STALE_TARGET: "the stamp is further from now than max_target_age",
    IkStatus.PATH_LENGTH: "a path has no pose, or more than max_path_poses",
    IkStatus.OUTSIDE_WORKSPACE_BOX: "the position is outside workspace_box_lower and _upper",
    IkStatus.NOT_FINITE: "a number is NaN or infinite",
    IkStatus.NOT_UNIT_QUATERNION: (
        f"the quaternion's norm is not 1 within {QUATERNION_NORM_TOLERANCE:g}"
    ),
    IkStatus.OUTSIDE_WORKSPACE: "the robot can't reach the pose",
    IkStatus.NOT_CONVERGED: (
        "no joint positions were found: in the joint box, or, of a whole robot, within the limits"
    ),
    IkStatus.BRANCH_ENDS: (
        "of a whole robot: the branch of the previous command ends before the target, and "
        "allow_branch_change is false"
    ),
    IkStatus.JOINT_LIMIT: "the network's solution is outside the joint limits",
    IkStatus.RESIDUAL_TOO_LARGE: (
        "the solution is further from the target than max_position_residual or "
        "max_orientation_residual"
    ),
    IkStatus.EXPECTED_ERROR_TOO_LARGE: (
        "the robot may be further from where the calibrated model has it than "
        "max_expected_error or max_expected_orientation_error, or how far is unknown"
    ),
    IkStatus.JOINT_STEP_TOO_LARGE: "a joint would move by more than max_joint_step",
    IkStatus.JOINT_VELOCITY_TOO_LARGE: "a joint would move faster than max_joint_velocity",
    IkStatus.FIRST_COMMAND_TOO_FAR: (
        "the first command is further than max_first_step from the measured joint positions; or "
        "joint states are received from which they can't be taken; or there are none and "
        "first_command is near"
    ),
    IkStatus.TOO_FAR_FROM_MEASURED: (
        "the command is further than max_measured_step from the measured joint positions, or "
        "joint states are received from which they can't be taken"
    ),
    IkStatus.SOLVER_FAILED: "an unforeseen error",
}
