"""Which namespace of a bag holds the robot."""

from __future__ import annotations

from msg_tools.bags.reader import Bag
from msg_tools.report.errors import AmbiguousNamespace, UnknownNamespace
from msg_tools.topics import (
    ACCEPTED_TARGET,
    ACHIEVED_POSE,
    JOINT_COMMAND,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    TARGET_POSE,
    TARGET_POSE_STAMPED,
    Topic,
)

# joint_states is left out: robots that know nothing of annik publish it too.
_SIGNS_OF_A_SOLVER = (ACCEPTED_TARGET, JOINT_COMMAND)
_SIGNS_OF_A_ROBOT = (
    *_SIGNS_OF_A_SOLVER,
    TARGET_POSE,
    TARGET_POSE_STAMPED,
    ACHIEVED_POSE,
    POSITION_ERROR,
    ORIENTATION_ERROR,
)


def robot_namespaces(bag: Bag) -> tuple[str, ...]:
    """Namespaces of a bag that hold topics of annik, sorted; ``/`` is the root.

    Those where an ``ik_node`` answered come alone: targets in another namespace are then remapped
    ones, not another robot.
    """
    return _namespaces_with(bag, _SIGNS_OF_A_SOLVER) or _namespaces_with(bag, _SIGNS_OF_A_ROBOT)


def robot_namespace(bag: Bag, wanted: str | None = None) -> str:
    """The namespace to report on.

    Args:
        bag: the bag.
        wanted: the user's choice, with or without the leading slash; None to find the only one.

    Returns:
        The namespace with its leading slash; ``/`` if the bag holds no topic of annik at all.

    Raises:
        AmbiguousNamespace: if several hold a robot and none is wanted.
        UnknownNamespace: if the wanted one holds no topic of annik.
    """
    namespaces = robot_namespaces(bag)
    if wanted is not None:
        chosen = "/" + wanted.strip("/")
        if chosen not in _namespaces_with(bag, _SIGNS_OF_A_ROBOT):
            raise UnknownNamespace(bag.path, chosen, namespaces)
        return chosen
    if len(namespaces) > 1:
        raise AmbiguousNamespace(bag.path, namespaces)
    return namespaces[0] if namespaces else "/"


def _namespaces_with(bag: Bag, topics: tuple[Topic, ...]) -> tuple[str, ...]:
    found = set()
    for name in bag.topics:
        for topic in topics:
            if name.endswith("/" + topic.name):
                found.add(name[: -len(topic.name)].rstrip("/") or "/")
    return tuple(sorted(found))
