"""A joint of a URDF, and whether one of a chain can be honoured in full."""

import math
from collections.abc import Container, Mapping
from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree

from annik_core.pose import roll_pitch_yaw
from annik_core.robots.definition import checked_interval, checked_name
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.urdf_text import EXPAND_XACRO, has_substitution, is_to_be_expanded

#: Types of joints that move.
MOVING_TYPES = ("continuous", "prismatic", "revolute")
#: Limits of a continuous joint, to either side [rad]. A URDF gives it none; beyond these a double
#: does not resolve a tenth of a micro-radian.
CONTINUOUS_LIMIT = 1e9
#: A limit beyond this stands for none [rad or m]; a part of an origin is a mistake.
_NO_LIMIT = 1e6
#: Lengths of an axis whose squares neither overflow nor vanish.
_AXIS_LENGTHS = (1e-100, 1e100)
#: How far a quaternion's norm may be from one; a few digits are as many as some files have.
_NORM_TOLERANCE = 0.01
#: What these elements of a joint may have; anything else could change the kinematics.
_ATTRIBUTES = {"origin": {"xyz", "rpy", "quat_xyzw"}, "axis": {"xyz"}}
#: Elements of a joint that other formats have, and that would change the kinematics.
_FOREIGN = frozenset({"pose", "axis2", "thread_pitch", "screw_thread_pitch"})
_ZEROS = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """A joint of a URDF; its numbers are read only if it is part of the chain.

    Attributes:
        name: as in the file, as all of these: empty where there is none.
        kind: its type; of an element like <drake:joint>, that.
        given: its interval in the joint box, or None.
    """

    name: str
    kind: str
    parent: str
    child: str
    element: ElementTree.Element
    given: object
    source: str

    @classmethod
    def read(
        cls, element: ElementTree.Element, joint_box: Mapping[str, object], source: str
    ) -> "UrdfJoint":
        """Read its name and its links, which may be missing."""
        links = (element.find(tag) for tag in ("parent", "child"))
        parent, child = ("" if link is None else link.get("link", "") for link in links)
        # Other formats have their own joints, such as <drake:joint>.
        kind = element.get("type", "") if element.tag == "joint" else f"<{element.tag}>"
        name = element.get("name", "")
        return cls(name, kind, parent, child, element, joint_box.get(name), source)

    @property
    def links(self) -> tuple[str, str]:
        """Its parent and its child."""
        return self.parent, self.child

    def problem(self, links: Container[str]) -> str | None:
        """Why it joins no two links of the URDF, or None if it does."""
        what = f"joint {self.name!r}"
        for tag, link in (("parent", self.parent), ("child", self.child)):
            if self.element.find(tag) is None:
                return f"{what} has no <{tag}>"
            if not link.strip():
                return f"<{tag}> of {what} has no link"
            if link not in links:
                return f"{what} names link {link!r}, which the URDF lacks"
        if self.parent == self.child:
            return f"{what} forms a ring from link {self.child!r} to itself"
        return None

    @cached_property
    def xyz(self) -> tuple[float, ...]:
        """Position of its origin in the parent link [m]."""
        return self._vector("origin", "xyz") or _ZEROS

    @cached_property
    def rpy(self) -> tuple[float, ...]:
        """Roll, pitch, yaw of its origin [rad]."""
        rpy, quaternion = self._vector("origin", "rpy"), self._vector("origin", "quat_xyzw", 4)
        if quaternion is None:
            return rpy or _ZEROS
        if rpy is not None:
            raise self._refused("has both rpy and quat_xyzw in its <origin>: leave out one")
        norm = math.hypot(*quaternion)
        if abs(norm - 1.0) > _NORM_TOLERANCE:
            raise self._refused(f"has a quat_xyzw of norm {norm:.6g} in its <origin>, not 1")
        return roll_pitch_yaw([part / norm for part in quaternion])

    @cached_property
    def axis(self) -> tuple[float, ...]:
        """Direction in its own frame."""
        return self._vector("axis", "xyz") or (1.0, 0.0, 0.0)

    @cached_property
    def limits(self) -> tuple[float, float]:
        """Lower and upper limit of a moving joint [rad or m], within its soft limits.

        A joint whose interval is given has its hard limits, or, if it has none, the given ones.
        """
        return self._soft_limits if self.given is None else self._hard_limits

    @cached_property
    def _hard_limits(self) -> tuple[float, float]:
        if self.kind == "continuous":
            # It has no limits; some descriptions write -inf and inf.
            return -CONTINUOUS_LIMIT, CONTINUOUS_LIMIT
        lower, upper = self._limit("lower", 0), self._limit("upper", 1)
        if lower > upper:
            raise self._refused(f"has the lower limit {lower} above its upper limit {upper}")
        return lower, upper

    @property
    def _soft_limits(self) -> tuple[float, float]:
        keys = ("soft_lower_limit", "soft_upper_limit")
        low, high = (self._number("safety_controller", key) for key in keys)
        # The standard's default is 0 for both: none.
        if self.kind == "continuous" or low is None or high is None or low == high == 0.0:
            return self._hard_limits
        lower, upper = self._hard_limits
        soft = max(lower, low), min(upper, high)
        if soft[0] > soft[1]:
            raise self._refused(
                f"has no position within both its soft limits [{low}, {high}] and its limits "
                f"{[lower, upper]}"
            )
        return soft

    def check(self, coupled: bool) -> None:
        """Refuse a joint of the chain that is not supported, or whose numbers are no numbers."""
        if not self.name.strip():
            raise InvalidRobotDefinition(
                self.source, f"the joint from link {self.parent!r} to {self.child!r} has no name"
            )
        checked_name(self.name, "the name of a joint", self.source)
        if not self.kind.strip():
            raise self._refused("has no type")
        self._check_elements()
        _ = self.xyz, self.rpy
        if self.kind == "fixed":
            return
        if self.kind not in MOVING_TYPES:
            raise self._refused(
                f"is {self.kind}; between the base and the end effector joints can be fixed, "
                f"{', '.join(MOVING_TYPES)}"
            )
        mimic = self.element.find("mimic")
        if mimic is not None or coupled:
            raise self._refused(
                f"mimics joint {'?' if mimic is None else mimic.get('joint', '?')!r}: coupled "
                "joints are not supported; choose an end_effector_frame before it, or make it "
                "fixed in a copy of the URDF"
            )
        shortest, longest = _AXIS_LENGTHS
        if not shortest < math.hypot(*self.axis) < longest:
            raise self._refused(f"has the axis {self.axis}: not a direction")
        _ = self.limits

    def _check_elements(self) -> None:
        """Refuse what would change the kinematics and is not understood."""
        fixed = self.kind == "fixed"
        for element in self.element:
            tag = element.tag
            if is_to_be_expanded(element):
                raise self._refused(f"has <{tag}>: {EXPAND_XACRO}")
            if tag.rpartition(":")[2] in _FOREIGN:
                raise self._refused(f"has <{tag}>, which is not supported in a URDF")
            if tag not in _ATTRIBUTES or (fixed and tag != "origin"):
                continue
            # Zeros mean nothing in any format, such as the rpy of an axis.
            unknown = [
                *(key for key, text in element.items() if text.strip(" 0.-+")),
                *(f"<{inner.tag}>" for inner in element),
            ]
            unknown = [name for name in unknown if name not in _ATTRIBUTES[tag]]
            if (element.text or "").strip():
                unknown.append(repr((element.text or "").strip()))
            if unknown:
                raise self._refused(
                    f"has {unknown[0]} in its <{tag}>, which is not supported; use "
                    f"{', '.join(sorted(_ATTRIBUTES[tag]))}"
                )
        for tag in ("parent", "child", "origin", *(() if fixed else ("axis", "limit", "mimic"))):
            found = self.element.findall(tag)
            if any(other.attrib != found[0].attrib for other in found[1:]):
                raise self._refused(f"has two different <{tag}>")

    def _refused(self, problem: str) -> InvalidRobotDefinition:
        return InvalidRobotDefinition(self.source, f"joint {self.name!r} {problem}")

    def _vector(self, tag: str, key: str, count: int = 3) -> tuple[float, ...] | None:
        text = self._text(tag, key)
        if text is None:
            return None
        numbers = tuple(map(_as_number, text.split()))
        most = _NO_LIMIT if tag == "origin" else math.inf
        if len(numbers) != count or not all(abs(number) < most for number in numbers):
            words = {3: "three", 4: "four"}[count]
            raise self._refused(
                f"has {key} {text!r} in its <{tag}>: not {words} numbers below {most:g}"
            )
        return numbers

    def _limit(self, key: str, index: int) -> float:
        """A limit of its own, or else of the joint box."""
        limit = self._number("limit", key)
        if limit is not None and abs(limit) <= _NO_LIMIT:
            return limit
        if self.given is None:
            has = f"no {key} limit" if limit is None else f"the {key} limit {limit}"
            raise self._refused(
                f"is {self.kind} and has {has}: give its interval by joint_box "
                f"(--joint-box {self.name}=LOWER:UPPER), add <limit lower=... upper=.../> to it, "
                "or make it continuous if it has none"
            )
        return checked_interval(self.given, self.kind, self.name, self.source)[index]

    def _number(self, tag: str, key: str) -> float | None:
        text = self._text(tag, key)
        number = None if text is None or not text.strip() else _as_number(text)
        if number is not None and math.isnan(number):
            raise self._refused(f"has the {key} limit {text!r}: not a number")
        return number

    def _text(self, tag: str, key: str) -> str | None:
        element = self.element.find(tag)
        text = None if element is None else element.get(key)
        if text is not None and has_substitution(text):
            raise self._refused(f"has {key} {text!r} in its <{tag}>: {EXPAND_XACRO}")
        return text


def _as_number(text: str) -> float:
    """The number, or NaN. Python would read 1_000 too."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan
