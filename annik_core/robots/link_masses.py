"""The masses of a URDF's links, as far as they turn the joints of a chain by their weight."""

import math
from collections import deque
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from annik_core.pose import FloatArray, quaternion_from_roll_pitch_yaw, rotation_matrix
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.urdf_joint import UrdfJoint
from annik_core.robots.urdf_tree import UrdfTree

#: Ends of a link nearer to each other are one place [m].
_ONE_PLACE = 1e-6
#: More is no mass of a robot's link [kg].
_LARGEST_MASS = 1e5


def masses_at_places(
    root: ElementTree.Element, tree: UrdfTree, base: str, path: Sequence[tuple[UrdfJoint, bool]]
) -> tuple[float, ...] | None:
    """Masses [kg] at the places of :class:`annik_core.robots.corrections.Deflection`.

    Those of a link, and of what hangs on it off the chain, are shared between its two ends, the
    origins of its joints, so that their common centre is as near to theirs as it can be.
    Joints off the chain are at zero. None, if the URDF has no masses that can be used.
    """
    masses = {link.get("name", ""): _mass(link) for link in root.iterfind("link")}
    try:
        origins, bodies = _placed(tree, base, [joint for joint, _ in path])
    except (InvalidRobotDefinition, ValueError, ArithmeticError):
        return None
    last, upwards = path[-1]
    links = [joint.child for joint, _ in path if _moves(joint)]
    places = [origins[link][:3, 3] for link in (*links, last.parent if upwards else last.child)]
    shared = np.zeros(len(places))
    for link, body in bodies.items():
        given = masses.get(link)
        if given is None or body == 0:
            continue
        mass, centre = given
        along = places[body] - places[body - 1]
        length = float(along @ along)
        away = (origins[link] @ [*centre, 1.0])[:3] - places[body - 1]
        share = float(away @ along) / length if length > _ONE_PLACE**2 else 0.0
        shared[body] += share * mass
        shared[body - 1] += (1.0 - share) * mass
    # What is at the first place turns no joint.
    found = shared[1:]
    return tuple(found.tolist()) if np.isfinite(found).all() and found.any() else None


def _placed(
    tree: UrdfTree, base: str, path: Sequence[UrdfJoint]
) -> tuple[dict[str, FloatArray], dict[str, int]]:
    """Frames ``(4, 4)`` of all links at zero, and how many joints of the chain move each."""
    origins, bodies, queue = {base: np.eye(4)}, {base: 0}, deque([base])
    while queue:
        link = queue.popleft()
        for joint in (*tree.below.get(link, ()), *tree.above.get(link, ())):
            other = joint.child if link == joint.parent else joint.parent
            if other in origins:
                continue
            origin = _origin(joint)
            step = origin if link == joint.parent else np.linalg.inv(origin)
            origins[other] = origins[link] @ step
            bodies[other] = bodies[link] + (joint in path and _moves(joint))
            queue.append(other)
    return origins, bodies


def _moves(joint: UrdfJoint) -> bool:
    return joint.kind != "fixed"


def _origin(joint: UrdfJoint) -> FloatArray:
    origin = np.eye(4)
    origin[:3, :3] = rotation_matrix(np.array(quaternion_from_roll_pitch_yaw(*joint.rpy)))
    origin[:3, 3] = joint.xyz
    return origin


def _mass(link: ElementTree.Element) -> tuple[float, list[float]] | None:
    """Mass [kg] and its centre [m] of a link, or None."""
    mass, origin = link.find("inertial/mass"), link.find("inertial/origin")
    try:
        value = float("" if mass is None else mass.get("value", ""))
        text = "" if origin is None else origin.get("xyz", "")
        centre = [float(number) for number in (text or "0 0 0").split()]
    except ValueError:
        return None
    usable = 0.0 < value < _LARGEST_MASS and len(centre) == 3 and all(map(math.isfinite, centre))
    return (value, centre) if usable else None
