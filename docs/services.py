"""The services of ``ik_node``, for the documentation and the test that compares them with it."""

from typing import NamedTuple

from annik_ros.ik_node.parameters import COMPUTE_IK, RELOAD_MODEL


class Service(NamedTuple):
    """A service, private to the node."""

    name: str
    type: str
    meaning: str


_TRANSITIONS = "lifecycle_msgs/srv/GetAvailableTransitions"
SERVICES = (
    Service(
        RELOAD_MODEL,
        "std_srvs/srv/Trigger",
        "load the file of the parameter `model`, and use it from the next target on if it passes "
        "every check and is for the same robot; otherwise keep the present model, and return why. "
        "Targets are solved meanwhile; a call during a reload is answered busy",
    ),
    Service(
        COMPUTE_IK,
        "moveit_msgs/srv/GetPositionIK",
        "where moveit_msgs is installed: the solution that is nearest to the robot state of the "
        "request, otherwise to where the robot is; the robot stays. Group, timeout and collisions "
        "are not looked at; of several links, none",
    ),
    Service(
        "~/change_state",
        "lifecycle_msgs/srv/ChangeState",
        "configure, activate, deactivate, cleanup or shutdown; `ros2 lifecycle set`",
    ),
    Service("~/get_state", "lifecycle_msgs/srv/GetState", "the state; `ros2 lifecycle get`"),
    Service(
        "~/get_available_states",
        "lifecycle_msgs/srv/GetAvailableStates",
        "all states of a managed node",
    ),
    Service(
        "~/get_available_transitions",
        _TRANSITIONS,
        "the transitions from the present state; `ros2 lifecycle list`",
    ),
    Service("~/get_transition_graph", _TRANSITIONS, "all transitions of a managed node"),
)
