"""The namespace of the robot in a bag."""

from collections.abc import Sequence
from pathlib import Path

from annik_core.errors import AnnikError
from msg_tools import topics
from msg_tools.bags.reader import Bag

# Without joint_states, which robots without annik publish too.
_SOLVER_TOPICS = (topics.ACCEPTED_TARGET, topics.JOINT_COMMAND)
_ROBOT_TOPICS = (
    *_SOLVER_TOPICS,
    topics.TARGET_POSE,
    topics.TARGET_POSE_STAMPED,
    topics.ACHIEVED_POSE,
    topics.POSITION_ERROR,
    topics.ORIENTATION_ERROR,
)


class NamespaceError(AnnikError):
    """The namespace to report on is unknown, or not the only one."""

    def __init__(self, path: Path, wanted: str | None, namespaces: Sequence[str]) -> None:
        self.path = path
        self.wanted = wanted  #: the namespace that was asked for; None if none was
        self.namespaces = tuple(namespaces)  #: those that hold a robot
        found = ", ".join(namespaces) or "none"
        super().__init__(
            f"bag {path}: robots in several namespaces: {found}; choose one as 'namespace'"
            if wanted is None
            else f"bag {path}: no topic of annik in {wanted}; namespaces with a robot: {found}"
        )


def robot_namespace(bag: Bag, wanted: str | None = None) -> str:
    """The namespace to report on, with its leading slash; ``/`` if the bag has no topic of annik.

    If none is wanted, it is the only one that holds a robot.

    Raises:
        NamespaceError: if the wanted one holds no topic of annik, or none is wanted and several
            hold a robot.
    """
    # Where an ik_node sent commands, targets elsewhere were remapped.
    namespaces = _namespaces_with(bag, _SOLVER_TOPICS) or _namespaces_with(bag, _ROBOT_TOPICS)
    if wanted is not None:
        chosen = "/" + wanted.strip("/")
        if chosen not in _namespaces_with(bag, _ROBOT_TOPICS):
            raise NamespaceError(bag.path, chosen, namespaces)
        return chosen
    if len(namespaces) > 1:
        raise NamespaceError(bag.path, None, namespaces)
    return namespaces[0] if namespaces else "/"


def _namespaces_with(bag: Bag, wanted: tuple[topics.Topic, ...]) -> tuple[str, ...]:
    found = set()
    for name in bag.topics:
        for topic in wanted:
            if name.endswith("/" + topic.name):
                found.add(name[: -len(topic.name)].rstrip("/") or "/")
    return tuple(sorted(found))
