"""The serial chain between two frames of a URDF: read, checked, and written as a URDF of its own.

Only the kinematics are kept, since a model file carries no meshes. What Pinocchio would ignore
silently is refused here, with the reason and the remedy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree

from annik_core.robots.definition import checked_name
from annik_core.robots.errors import InvalidRobotDefinition

#: Types of joints that move.
MOVING_TYPES = ("continuous", "prismatic", "revolute")
#: Limits of a continuous joint, to either side [rad]. A URDF gives it none; beyond these a double
#: does not resolve a tenth of a micro-radian.
CONTINUOUS_LIMIT = 1e9
#: Most joints of a chain, fixed ones included; Pinocchio's reader recurses that deep.
MAX_CHAIN = 256
#: Most characters of a URDF; a description is some 100 kB with all its links.
MAX_LENGTH = 16 * 1024 * 1024
#: May begin a text file from Windows.
BYTE_ORDER_MARK = "\ufeff"
#: Lengths of an axis whose squares neither overflow nor vanish.
_AXIS_LENGTHS = (1e-100, 1e100)


@dataclass(frozen=True)
class SerialChain:
    """A chain of joints from a base frame to an end effector.

    Attributes:
        name: the robot's, as the URDF gives it.
        urdf: the chain alone, as URDF text that is the same for the same chain.
        base_frame: its first link.
        end_effector_frame: its last link.
        joint_names: the moving joints, from the base on.
        joint_types: ``revolute``, ``continuous`` or ``prismatic``, one per joint.
        lower: lower limits [rad or m]; for a continuous joint :data:`CONTINUOUS_LIMIT`.
        upper: upper limits.
    """

    name: str
    urdf: str
    base_frame: str
    end_effector_frame: str
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]


def serial_chain(
    urdf: str, source: str, base_frame: str | None = None, end_effector_frame: str | None = None
) -> SerialChain:
    """The chain between two frames of a URDF.

    Args:
        urdf: the text, such as the parameter ``robot_description`` has.
        source: what to call it in an error.
        base_frame: its first link; by default the root of the tree.
        end_effector_frame: its last link; by default the tip, if there is only one.

    Raises:
        InvalidRobotDefinition: if the text is not a URDF, or the chain can't be used; names the
            joint or frame and what to do.
    """
    root = _parsed(urdf, source)
    joints = [_Joint.read(element, source) for element in root.findall("joint")]
    _check_unique([joint.name for joint in joints], "joint", source)
    links = [_attribute(link, "name", "a link", source) for link in root.findall("link")]
    _check_unique(links, "link", source)
    if not links:
        raise InvalidRobotDefinition(source, "it has no links: not the URDF of an arm")
    known = frozenset(links)
    by_child: dict[str, _Joint] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in known:
                raise InvalidRobotDefinition(
                    source, f"joint {joint.name!r} names link {link!r}, which the URDF lacks"
                )
        if joint.child in by_child:
            raise InvalidRobotDefinition(
                source,
                f"link {joint.child!r} hangs on two joints, {by_child[joint.child].name!r} and "
                f"{joint.name!r}: a URDF is a tree",
            )
        by_child[joint.child] = joint
    _check_no_ring(by_child, source)
    for what, frame in (("base_frame", base_frame), ("end_effector_frame", end_effector_frame)):
        if frame is not None and frame not in known:
            raise InvalidRobotDefinition(
                source, f"{what} {frame!r} is not a link of the URDF; its links: {_listed(links)}"
            )
    base = base_frame or _only_root(links, by_child, source)
    tip = end_effector_frame or _only_tip(links, joints, base, by_child, source)
    path = _path(base, tip, by_child, source)
    if len(path) > MAX_CHAIN:
        raise InvalidRobotDefinition(
            source, f"the chain has {len(path)} joints, fixed ones included, more than {MAX_CHAIN}"
        )
    for joint in path:
        joint.check()
    moving = [joint for joint in path if joint.kind != "fixed"]
    if not moving:
        raise InvalidRobotDefinition(
            source, f"nothing moves between base_frame {base!r} and end_effector_frame {tip!r}"
        )
    return SerialChain(
        name=root.get("name") or "robot",
        urdf=_written(root.get("name") or "robot", base, path),
        base_frame=base,
        end_effector_frame=tip,
        joint_names=tuple(joint.name for joint in moving),
        joint_types=tuple(joint.kind for joint in moving),
        lower=tuple(joint.limits[0] for joint in moving),
        upper=tuple(joint.limits[1] for joint in moving),
    )


@dataclass(frozen=True)
class _Joint:
    """A joint of the URDF; its numbers are read only if it is part of the chain."""

    name: str
    kind: str
    parent: str
    child: str
    element: ElementTree.Element
    source: str

    @classmethod
    def read(cls, element: ElementTree.Element, source: str) -> _Joint:
        name = _attribute(element, "name", "a joint", source)
        what = f"joint {name!r}"
        return cls(
            name=name,
            kind=_attribute(element, "type", what, source),
            parent=_linked(element, "parent", what, source),
            child=_linked(element, "child", what, source),
            element=element,
            source=source,
        )

    @cached_property
    def xyz(self) -> tuple[float, ...]:
        """Position of its origin in the parent link [m]."""
        return self._vector("origin", "xyz", (0.0, 0.0, 0.0))

    @cached_property
    def rpy(self) -> tuple[float, ...]:
        """Roll, pitch, yaw of its origin [rad]."""
        return self._vector("origin", "rpy", (0.0, 0.0, 0.0))

    @cached_property
    def axis(self) -> tuple[float, ...]:
        """Direction in its own frame."""
        return self._vector("axis", "xyz", (1.0, 0.0, 0.0))

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of a moving joint [rad or m]."""
        if self.kind == "continuous":
            # It has no limits; some descriptions write -inf and inf.
            return -CONTINUOUS_LIMIT, CONTINUOUS_LIMIT
        lower, upper = self._limit("lower"), self._limit("upper")
        if lower > upper:
            raise self._refused(f"has the lower limit {lower} above its upper limit {upper}")
        return lower, upper

    def check(self) -> None:
        """Refuse a joint of the chain that is not supported, or whose numbers are no numbers."""
        _ = self.xyz, self.rpy, self.axis
        if self.kind == "fixed":
            return
        if self.kind not in MOVING_TYPES:
            raise self._refused(
                f"is {self.kind}; between the base and the end effector joints can be fixed, "
                f"{', '.join(MOVING_TYPES)}"
            )
        mimic = self.element.find("mimic")
        if mimic is not None:
            raise self._refused(
                f"mimics joint {mimic.get('joint', '?')!r}: coupled joints are not supported; "
                "choose an end_effector_frame before it, or make it fixed in a copy of the URDF"
            )
        shortest, longest = _AXIS_LENGTHS
        if not shortest < math.hypot(*self.axis) < longest:
            raise self._refused(f"has the axis {self.axis}: not a direction")
        _ = self.limits

    def _refused(self, problem: str) -> InvalidRobotDefinition:
        return InvalidRobotDefinition(self.source, f"joint {self.name!r} {problem}")

    def _vector(self, tag: str, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        text = self._text(tag, key)
        if text is None:
            return default
        try:
            numbers = tuple(float(part) for part in text.split())
        except ValueError:
            numbers = ()
        if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
            raise self._refused(f"has {key} {text!r} in its <{tag}>: not three numbers")
        return numbers

    def _limit(self, key: str) -> float:
        text = self._text("limit", key)
        if text is None:
            raise self._refused(
                f"is {self.kind} and has no {key} limit: add <limit lower=... upper=.../> to it, "
                "or make it continuous if it has none"
            )
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise self._refused(f"has the {key} limit {text!r}: not a number")
        return number

    def _text(self, tag: str, key: str) -> str | None:
        element = self.element.find(tag)
        return None if element is None else element.get(key)


def _parsed(urdf: str, source: str) -> ElementTree.Element:
    if len(urdf) > MAX_LENGTH:
        raise InvalidRobotDefinition(
            source, f"{len(urdf)} characters are more than the {MAX_LENGTH} of the longest URDF"
        )
    if "<!ENTITY" in urdf:
        raise InvalidRobotDefinition(source, "the XML declares entities, which no URDF needs")
    try:
        root = ElementTree.fromstring(urdf.removeprefix(BYTE_ORDER_MARK).strip())
    except (ElementTree.ParseError, ValueError) as error:
        raise InvalidRobotDefinition(source, f"not XML: {error}") from error
    if any("xacro" in element.tag for element in root.iter()):
        raise InvalidRobotDefinition(
            source, "it is xacro, which has to be expanded: xacro FILE > robot.urdf"
        )
    # A default namespace, such as Drake's, is part of every tag.
    namespace = root.tag[: root.tag.rfind("}") + 1]
    for element in root.iter():
        element.tag = element.tag.removeprefix(namespace)
    if root.tag != "robot":
        raise InvalidRobotDefinition(
            source, f"not a URDF: its outermost element is <{root.tag}>, not <robot>"
        )
    return root


def _attribute(element: ElementTree.Element, key: str, what: str, source: str) -> str:
    value = element.get(key)
    if value is None or not value.strip():
        raise InvalidRobotDefinition(source, f"{what} has no {key}")
    return checked_name(value, f"the {key} of {what}", source)


def _linked(element: ElementTree.Element, tag: str, what: str, source: str) -> str:
    linked = element.find(tag)
    if linked is None:
        raise InvalidRobotDefinition(source, f"{what} has no <{tag}>")
    return _attribute(linked, "link", f"<{tag}> of {what}", source)


def _check_unique(names: Sequence[str], what: str, source: str) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise InvalidRobotDefinition(source, f"it has two {what}s named {name!r}")
        seen.add(name)


def _check_no_ring(by_child: dict[str, _Joint], source: str) -> None:
    """Refuse joints that form a ring."""
    rooted: set[str] = set()
    for link in by_child:
        above: list[str] = []
        passed: set[str] = set()
        while link in by_child and link not in rooted:
            if link in passed:
                ring = above[above.index(link) :]
                raise InvalidRobotDefinition(
                    source, f"its joints form a ring through {_listed(ring)}: a URDF is a tree"
                )
            above.append(link)
            passed.add(link)
            link = by_child[link].parent
        rooted |= passed


def _only_root(links: Sequence[str], by_child: dict[str, _Joint], source: str) -> str:
    roots = [link for link in links if link not in by_child]
    if len(roots) != 1:
        raise InvalidRobotDefinition(
            source,
            f"the base frame is not clear: give base_frame, a link such as {_listed(roots)}",
        )
    return roots[0]


def _only_tip(
    links: Sequence[str],
    joints: Sequence[_Joint],
    base: str,
    by_child: dict[str, _Joint],
    source: str,
) -> str:
    parents = {joint.parent for joint in joints}
    tips = [link for link in links if link not in parents and base in _ancestors(link, by_child)]
    if len(tips) != 1:
        raise InvalidRobotDefinition(
            source,
            "the end effector is not clear, the tree has several tips: give end_effector_frame, "
            f"one of its links, such as {_listed(tips)}"
            if tips
            else f"nothing hangs on base_frame {base!r}",
        )
    return tips[0]


def _ancestors(link: str, by_child: dict[str, _Joint]) -> list[str]:
    """The links between one and the root, nearest first."""
    above: list[str] = []
    while link in by_child:
        link = by_child[link].parent
        above.append(link)
    return above


def _path(base: str, tip: str, by_child: dict[str, _Joint], source: str) -> list[_Joint]:
    above = _ancestors(tip, by_child)
    if base not in above:
        raise InvalidRobotDefinition(
            source,
            f"end_effector_frame {tip!r} does not hang on base_frame {base!r}; above it are "
            f"{_listed(above) or 'no links'}",
        )
    links = [tip, *above[: above.index(base)]]
    return [by_child[link] for link in reversed(links)]


def _listed(names: Sequence[str], most: int = 12) -> str:
    listed = ", ".join(names[:most])
    return f"{listed}, ..." if len(names) > most else listed


def _written(name: str, base: str, chain: Sequence[_Joint]) -> str:
    """The chain as URDF text; ``repr`` keeps every bit of a number."""
    root = ElementTree.Element("robot", name=name)
    ElementTree.SubElement(root, "link", name=base)
    for joint in chain:
        element = ElementTree.SubElement(root, "joint", name=joint.name, type=joint.kind)
        ElementTree.SubElement(element, "parent", link=joint.parent)
        ElementTree.SubElement(element, "child", link=joint.child)
        ElementTree.SubElement(element, "origin", xyz=_numbers(joint.xyz), rpy=_numbers(joint.rpy))
        if joint.kind != "fixed":
            ElementTree.SubElement(element, "axis", xyz=_numbers(joint.axis))
            limits = {}
            if joint.kind != "continuous":
                limits = {"lower": repr(joint.limits[0]), "upper": repr(joint.limits[1])}
            # Effort and velocity are required by the format, not used.
            ElementTree.SubElement(element, "limit", {**limits, "effort": "0", "velocity": "0"})
        ElementTree.SubElement(root, "link", name=joint.child)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(value) for value in values)
