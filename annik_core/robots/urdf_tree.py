"""The tree of links and joints of a URDF, and the way from one link to another."""

from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree

from annik_core.errors import listed
from annik_core.robots.definition import checked_name
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.urdf_joint import UrdfJoint
from annik_core.robots.urdf_text import (
    EXPAND_XACRO,
    UNDECODED,
    has_substitution,
    is_to_be_expanded,
)

#: Most joints of a chain, fixed ones included.
MAX_CHAIN = 256


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """The links and joints of a URDF.

    Attributes:
        links: their names, in the order of the file, and how many have each.
        joints: those that join two links.
        names: how many joints have each name.
        loose: what could be part of the tree and is not understood, as text.
    """

    links: Counter[str]
    joints: tuple[UrdfJoint, ...]
    names: Counter[str]
    loose: tuple[str, ...]
    source: str

    @classmethod
    def read(
        cls, root: ElementTree.Element, joint_box: Mapping[str, object], source: str
    ) -> "UrdfTree":
        """Read the links and joints of a URDF, of which any may be off the chain.

        Raises:
            InvalidRobotDefinition: if it has no links.
        """
        links = Counter(link.get("name", "") for link in root.iterfind("link"))
        joints, loose, names = [], [], Counter[str]()
        for element in root:
            if is_to_be_expanded(element):
                loose.append(f"it has <{element.tag}>: {EXPAND_XACRO}")
            elif element.tag.rpartition(":")[2] == "joint":
                joint = UrdfJoint.read(element, joint_box, source)
                problem = joint.problem(links)
                if problem is None:
                    joints.append(joint)
                elif element.tag == "joint":
                    loose.append(problem)
                names[joint.name] += problem is None or element.tag == "joint"
        tree = cls(links, tuple(joints), names, tuple(loose), source)
        if not links:
            raise tree._refused("it has no links: not the URDF of an arm")
        return tree

    @cached_property
    def above(self) -> dict[str, list[UrdfJoint]]:
        """The joints above each link; in a tree one, or none above the root."""
        return _grouped(self.joints, "child")

    @cached_property
    def below(self) -> dict[str, list[UrdfJoint]]:
        """The joints that hang on each link."""
        return _grouped(self.joints, "parent")

    def frames(self, base: str | None, tip: str | None) -> tuple[str, str]:
        """The given frames, completed by the root and the only tip below it."""
        for what, frame in (("base_frame", base), ("end_effector_frame", tip)):
            if frame is not None and frame not in self.links:
                links = listed(list(self.links))
                raise self._refused(
                    f"{what} {frame!r} is not a link of the URDF; its links: {links}"
                )
        if self.loose and (base is None or tip is None):
            # It may have the root or a tip.
            raise InvalidRobotDefinition(
                self.source, f"{self.loose[0]}; or give base_frame and end_effector_frame both"
            )
        base = base or (self._only_root() if tip is None else self._top(tip))
        return base, tip or self._only_tip(base)

    def path(self, base: str, tip: str) -> list[tuple[UrdfJoint, bool]]:
        """The joints from one link to another, and whether each is passed up the tree."""
        if base == tip:
            raise self._refused(f"base_frame {base!r} is end_effector_frame {tip!r} too")
        came = self._reached({base}, ())
        if tip not in came:
            raise self._refused(
                f"no joints lead from base_frame {base!r} to end_effector_frame {tip!r}"
            )
        links, joints = [tip], []
        while links[-1] != base:
            joint, link = came[links[-1]]
            joints.append((joint, link == joint.child))
            links.append(link)
        if len(joints) > MAX_CHAIN:
            raise self._refused(
                f"the chain has {len(joints)} joints, fixed ones included, more than {MAX_CHAIN}"
            )
        self._check_no_ring(links, [joint for joint, _ in joints])
        return joints[::-1]

    def check_names(self, path: Sequence[tuple[UrdfJoint, bool]]) -> None:
        """Refuse names of the chain that are no names, or that others have too."""
        for what, names, taken in (
            ("joint", [joint.name for joint, _ in path], self.names),
            ("link", [link for joint, _ in path for link in joint.links], self.links),
        ):
            for name in names:
                checked_name(name, f"the name of a {what}", self.source)
                if has_substitution(name):
                    raise self._refused(f"{what} {name!r}: {EXPAND_XACRO}")
                if UNDECODED in name:
                    raise self._refused(
                        f"{what} {name!r} has characters outside the encoding of the file: save "
                        "it as UTF-8"
                    )
                if taken[name] > 1:
                    raise self._refused(f"it has two {what}s named {name!r}")

    def _only_root(self) -> str:
        joined = [link for link in self.links if link in self.above or link in self.below]
        roots = [link for link in joined or self.links if link not in self.above]
        # Beside the robot's there may be one of a camera, say, on which nothing moves.
        moving = [root for root in roots if any(self._moving_below(root).values())]
        if len(roots) > 1 and len(moving) == 1:
            roots = moving
        if not roots:
            self._top(joined[0])
        if len(roots) != 1:
            raise self._refused(
                f"the base frame is not clear: give base_frame, a link such as {listed(roots)}"
            )
        return roots[0]

    def _top(self, link: str) -> str:
        """The root above a link."""
        passed: dict[str, None] = {}
        while (joints := self.above.get(link)) is not None:
            if link in passed:
                names = list(passed)
                raise self._ring(names[names.index(link) :])
            passed[link] = None
            link = joints[0].parent
        return link

    def _only_tip(self, base: str) -> str:
        below = self._moving_below(base)
        tips = [link for link in below if link not in self.below]
        if base in tips:
            hint = ": give end_effector_frame" if self.joints else ""
            raise self._refused(f"nothing hangs on base_frame {base!r}{hint}")
        if not tips:
            self._top(base)
        if len(tips) != 1:
            tips.sort(key=lambda link: -below[link])
            counted = [f"{tip} ({below[tip]} joint{'s' * (below[tip] != 1)})" for tip in tips]
            raise self._refused(
                "the end effector is not clear, the tree has several tips: give "
                f"end_effector_frame, one of its links, such as {listed(counted)}"
            )
        return tips[0]

    def _moving_below(self, base: str) -> dict[str, int]:
        """The links below one, itself included, with the number of moving joints up to it."""
        counts, queue = {base: 0}, deque([base])
        while queue:
            link = queue.popleft()
            for joint in self.below.get(link, ()):
                if joint.child not in counts:
                    counts[joint.child] = counts[link] + (joint.kind != "fixed")
                    queue.append(joint.child)
        return counts

    def _reached(
        self, starts: Iterable[str], without: Iterable[UrdfJoint]
    ) -> dict[str, tuple[UrdfJoint, str]]:
        """The links that joints lead to from some others: the last joint, and where it began."""
        came: dict[str, tuple[UrdfJoint, str]] = {}
        passed, queue = set(without), deque(starts)
        while queue:
            link = queue.popleft()
            for joint in (*self.below.get(link, ()), *self.above.get(link, ())):
                if joint not in passed:
                    passed.add(joint)
                    other = joint.child if link == joint.parent else joint.parent
                    if other not in came:
                        came[other] = joint, link
                        queue.append(other)
        return came

    def _check_no_ring(self, links: Sequence[str], path: Sequence[UrdfJoint]) -> None:
        """Refuse a chain of which some links are joined by other joints too."""
        for link in links:
            above = self.above.get(link, [])
            if len(above) > 1:
                raise self._refused(
                    f"link {link!r} hangs on two joints, {above[0].name!r} and {above[1].name!r}: "
                    "a URDF is a tree"
                )
        for link in links:
            again = set(links) & set(self._reached({link}, path)) - {link}
            if again:
                raise self._ring([link, *sorted(again)])

    def _ring(self, links: Sequence[str]) -> InvalidRobotDefinition:
        return self._refused(f"its joints form a ring through {listed(links)}: a URDF is a tree")

    def _refused(self, problem: str) -> InvalidRobotDefinition:
        return InvalidRobotDefinition(self.source, "; ".join((problem, *self.loose[:1])))


def _grouped(joints: Iterable[UrdfJoint], link: str) -> dict[str, list[UrdfJoint]]:
    groups: defaultdict[str, list[UrdfJoint]] = defaultdict(list)
    for joint in joints:
        groups[getattr(joint, link)].append(joint)
    return dict(groups)
