"""Table of the topics of annik, for the nodes, the recorder, the report and the documentation."""

from typing import NamedTuple


class Topic(NamedTuple):
    """A topic of annik: relative name, ROS message type, meaning with frame and units.

    Publisher and subscriber are nodes, bag_recorder apart; ``you`` sends the targets.
    """

    name: str
    type: str
    publisher: str
    subscriber: str
    meaning: str


TARGET_POSE = Topic(
    "target_pose",
    "geometry_msgs/msg/Pose",
    "you, target_publisher, or viewer",
    "ik_node",
    "target pose of the end effector in the base frame [m, unit quaternion]",
)
TARGET_POSE_STAMPED = Topic(
    "target_pose_stamped",
    "geometry_msgs/msg/PoseStamped",
    "you, or target_publisher",
    "ik_node",
    "the same with a frame: the base frame, empty, or one that tf2 knows",
)
TARGET_POSES = Topic(
    "target_poses",
    "geometry_msgs/msg/PoseArray",
    "you",
    "ik_node",
    "a path of target poses in the base frame, solved as a whole: one joint_trajectory, or none",
)
SOLUTIONS_TARGET = Topic(
    "solutions_target",
    "geometry_msgs/msg/PoseStamped",
    "you",
    "ik_node",
    "a pose whose solutions are asked for, without moving the robot; frame as target_pose_stamped",
)
SOLUTIONS = Topic(
    "solutions",
    "trajectory_msgs/msg/JointTrajectory",
    "ik_node",
    "you",
    "all joint positions that reach solutions_target [rad or m], one point each, nearest to the "
    "robot first: choices, not a motion, so all times are zero; none: no points; stamp: that of "
    "solutions_target",
)
JOINT_COMMAND = Topic(
    "joint_command",
    "sensor_msgs/msg/JointState",
    "ik_node, or example_collector",
    "the robot, or fake_robot",
    "joint positions that reach the target [rad or m]; stamp: when the target was accepted",
)
ACCEPTED_TARGET = Topic(
    "accepted_target",
    "geometry_msgs/msg/PoseStamped",
    "ik_node",
    "fake_robot, viewer",
    "the target of the command with the same stamp; published if there is a subscriber",
)
JOINT_TRAJECTORY = Topic(
    "joint_trajectory",
    "trajectory_msgs/msg/JointTrajectory",
    "ik_node",
    "ros2_control",
    "the joint positions for target_poses, and each command if publish_joint_trajectory is set, "
    "for ros2_control's joint_trajectory_controller [rad or m]; stamp: zero, to start at once",
)
POSITION_COMMANDS = Topic(
    "position_commands",
    "std_msgs/msg/Float64MultiArray",
    "ik_node",
    "ros2_control",
    "each command if publish_position_commands is set, for ros2_control's "
    "forward_command_controller, in the order of the joints [rad or m]",
)
JOINT_STATES = Topic(
    "joint_states",
    "sensor_msgs/msg/JointState",
    "the robot, or fake_robot",
    "ik_node, example_collector, viewer",
    "measured joint positions [rad or m]; the first command must be near them. fake_robot: "
    "after each command, with its stamp; at joint_state_rate; at measurement_rate, with the stamp "
    "of measured_pose",
)
ROBOT_DESCRIPTION = Topic(
    "robot_description",
    "std_msgs/msg/String",
    "fake_robot",
    "RViz",
    "the URDF of the robot, latched; tf beside it where tf2_msgs is installed",
)
ACHIEVED_POSE = Topic(
    "achieved_pose",
    "geometry_msgs/msg/PoseStamped",
    "fake_robot",
    "you, or viewer",
    "end-effector pose at those joint positions in the base frame, by the forward kinematics or "
    "with the errors of an imperfect arm; stamp: its command's",
)
MEASURED_POSE = Topic(
    "measured_pose",
    "geometry_msgs/msg/PoseStamped",
    "a tracker, or fake_robot",
    "example_collector",
    "end-effector pose in the base frame, with noise [m, unit quaternion]; stamp: time of the "
    "measurement",
)
POSITION_ERROR = Topic(
    "tracking_error/position",
    "geometry_msgs/msg/Vector3Stamped",
    "fake_robot",
    "you, or viewer",
    "target minus achieved position in the base frame [m]; stamp: its command's",
)
ORIENTATION_ERROR = Topic(
    "tracking_error/orientation",
    "geometry_msgs/msg/Vector3Stamped",
    "fake_robot",
    "you, or viewer",
    "rotation vector from achieved to target in the base frame [rad]; stamp: its command's",
)
DIAGNOSTICS = Topic(
    "/diagnostics",
    "diagnostic_msgs/msg/DiagnosticArray",
    "ik_node, fake_robot, example_collector",
    "you, or viewer",
    "model, robot, counts by outcome, times; every second",
)

TOPICS = tuple(topic for topic in list(globals().values()) if isinstance(topic, Topic))
