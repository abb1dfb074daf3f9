"""The serial chain between two links of a URDF: read, checked, and written as a URDF of its own.

A URDF is read for this chain and for nothing else. What is off the chain, or has no part in
kinematics, never refuses a robot; what is on it and is not understood always does, with the reason
and the remedy. A model file carries the chain alone.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from annik_core.pose import quaternion_from_roll_pitch_yaw, roll_pitch_yaw, rotation_matrix
from annik_core.robots.errors import InvalidRobotDefinition
from annik_core.robots.link_masses import masses_at_places
from annik_core.robots.urdf_joint import UrdfJoint
from annik_core.robots.urdf_text import parsed
from annik_core.robots.urdf_tree import UrdfTree


@dataclass(frozen=True)
class SerialChain:
    """A chain of joints from a base frame to an end effector.

    Attributes:
        urdf: the chain alone, as URDF text that is the same for the same chain.
        lower: lower limits, soft ones where there are [rad or m]; for a continuous joint
            :data:`annik_core.robots.urdf_joint.CONTINUOUS_LIMIT`.
        masses: of the links [kg], at the places of a deflection; see
            :func:`annik_core.robots.link_masses.masses_at_places`. None: not in the URDF.
    """

    name: str
    urdf: str
    base_frame: str
    end_effector_frame: str
    joint_names: tuple[str, ...]
    joint_types: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    masses: tuple[float, ...] | None = None


def serial_chain(
    urdf: str,
    source: str,
    base_frame: str | None = None,
    end_effector_frame: str | None = None,
    joint_box: Mapping[str, object] | None = None,
) -> SerialChain:
    """The chain between two links of a URDF, up the tree, down it, or both.

    It begins by default at the root of the tree, and ends at the tip below, if there is only one.
    Intervals of ``joint_box`` are the limits of joints that have none.

    Raises:
        InvalidRobotDefinition: if the text is not a URDF, or the chain can't be used; names the
            joint or frame and what to do.
    """
    root = parsed(urdf, source)
    tree = UrdfTree.read(root, joint_box or {}, source)
    base, tip = tree.frames(base_frame, end_effector_frame)
    path = tree.path(base, tip)
    coupled = {
        joint.get("name")
        for joint in root.iterfind("ros2_control/joint")
        if joint.find("param[@name='mimic']") is not None
    }
    for joint, _ in path:
        joint.check(joint.name in coupled)
    tree.check_names(path)
    moving = [joint for joint, _ in path if joint.kind != "fixed"]
    if not moving:
        raise InvalidRobotDefinition(
            source, f"nothing moves between base_frame {base!r} and end_effector_frame {tip!r}"
        )
    name = root.get("name") or "robot"
    return SerialChain(
        name=name,
        urdf=_written(name, base, path),
        base_frame=base,
        end_effector_frame=tip,
        joint_names=tuple(joint.name for joint in moving),
        joint_types=tuple(joint.kind for joint in moving),
        lower=tuple(joint.limits[0] for joint in moving),
        upper=tuple(joint.limits[1] for joint in moving),
        masses=masses_at_places(root, tree, base, path),
    )


def _written(name: str, base: str, path: Sequence[tuple[UrdfJoint, bool]]) -> str:
    """The chain as URDF text; ``repr`` keeps every bit of a number."""
    root = ElementTree.Element("robot", name=name)
    ElementTree.SubElement(root, "link", name=base)
    taken = {name for joint, _ in path for name in (joint.name, joint.parent, joint.child)}
    for joint, upwards in path:
        ends = (joint.child, joint.parent) if upwards else (joint.parent, joint.child)
        origin = _inverse(joint.xyz, joint.rpy) if upwards else (joint.xyz, joint.rpy)
        if joint.kind == "fixed":
            add_joint(root, joint.name, "fixed", *ends, origin)
            continue
        limits = None if joint.kind == "continuous" else joint.limits
        if upwards:
            # The joint is at the far end of its origin: first the motion back, then the origin.
            between = f"{joint.name} reversed"
            while between in taken:
                between += "'"
            back = tuple(0.0 - part for part in joint.axis)
            add_joint(root, joint.name, joint.kind, ends[0], between, axis=back, limits=limits)
            add_joint(root, between, "fixed", between, ends[1], origin)
        else:
            add_joint(root, joint.name, joint.kind, *ends, origin, joint.axis, limits)
    return as_text(root)


def add_joint(
    root: ElementTree.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: Sequence[Sequence[float]] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    axis: Sequence[float] | None = None,
    limits: Sequence[float] | None = None,
) -> ElementTree.Element:
    """Add a joint and its child link to ``<robot>``; ``axis`` is None for a fixed joint."""
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    xyz, rpy = map(as_numbers, origin)
    ElementTree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    if axis is not None:
        ElementTree.SubElement(joint, "axis", xyz=as_numbers(axis))
        bounds = zip(("lower", "upper"), map(repr, limits or ()), strict=False)
        # Effort and velocity are required by the format, not used.
        ElementTree.SubElement(joint, "limit", {**dict(bounds), "effort": "0", "velocity": "0"})
    ElementTree.SubElement(root, "link", name=child)
    return joint


def as_text(root: ElementTree.Element) -> str:
    """The element ``<robot>`` as the text of a URDF."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _inverse(
    xyz: Sequence[float], rpy: Sequence[float]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The origin of the parent link in the child's frame."""
    *vector, scalar = quaternion_from_roll_pitch_yaw(*rpy)
    back = [*(-part for part in vector), scalar]
    return tuple(rotation_matrix(np.array(back)) @ [-part for part in xyz]), roll_pitch_yaw(back)


def as_numbers(values: Iterable[float]) -> str:
    """Numbers as the text of an attribute, each with all its digits."""
    return " ".join(repr(float(value)) for value in values)
