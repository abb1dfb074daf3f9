"""The topics of annik: relative name, message type, who publishes, what it means.

One table for the nodes, the bag recorder, the report and the documentation. Needs no ROS.
"""

from __future__ import annotations

from typing import NamedTuple


class Topic(NamedTuple):
    """A topic of annik.

    Attributes:
        name: relative, so that namespaces and remapping work.
        type: ROS message type, such as ``geometry_msgs/msg/Pose``.
        publisher: the node that publishes it; ``you`` for the targets.
        meaning: what the message says, with frame and units.
    """

    name: str
    type: str
    publisher: str
    meaning: str


TARGET_POSE = Topic(
    "target_pose",
    "geometry_msgs/msg/Pose",
    "you",
    "wanted end-effector pose in the base frame [m, unit quaternion]",
)
TARGET_POSE_STAMPED = Topic(
    "target_pose_stamped",
    "geometry_msgs/msg/PoseStamped",
    "you",
    "the same with a frame, which must be the base frame or empty",
)
JOINT_COMMAND = Topic(
    "joint_command",
    "sensor_msgs/msg/JointState",
    "ik_node",
    "joint positions that reach the target [rad or m]; stamp: when the target was accepted",
)
ACCEPTED_TARGET = Topic(
    "accepted_target",
    "geometry_msgs/msg/PoseStamped",
    "ik_node",
    "the target of the command with the same stamp",
)
JOINT_STATES = Topic(
    "joint_states",
    "sensor_msgs/msg/JointState",
    "fake_robot",
    "joint positions that the robot took up [rad or m]; stamp: its command's",
)
ACHIEVED_POSE = Topic(
    "achieved_pose",
    "geometry_msgs/msg/PoseStamped",
    "fake_robot",
    "end-effector pose at those joint positions, by the direct kinematics; stamp: its command's",
)
POSITION_ERROR = Topic(
    "tracking_error/position",
    "geometry_msgs/msg/Vector3Stamped",
    "fake_robot",
    "target minus achieved position in the base frame [m]; stamp: its command's",
)
ORIENTATION_ERROR = Topic(
    "tracking_error/orientation",
    "geometry_msgs/msg/Vector3Stamped",
    "fake_robot",
    "rotation vector from achieved to target in the base frame [rad]; stamp: its command's",
)
DIAGNOSTICS = Topic(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    "ik_node, fake_robot",
    "model, robot, counts by outcome, solve times; once a second",
)

TOPICS = (
    TARGET_POSE,
    TARGET_POSE_STAMPED,
    JOINT_COMMAND,
    ACCEPTED_TARGET,
    JOINT_STATES,
    ACHIEVED_POSE,
    POSITION_ERROR,
    ORIENTATION_ERROR,
    DIAGNOSTICS,
)
