"""Small URDFs for the tests."""

from __future__ import annotations

from collections.abc import Iterable

DECLARATION = '<?xml version="1.0" encoding="utf-8"?>\n'


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    *,
    origin: str = 'xyz="0.1 -0.2 0.3" rpy="0.1 0.2 0.3"',
    axis: str = 'xyz="0 0 1"',
    limit: str = 'lower="-1" upper="1"',
    more: str = "",
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f"<origin {origin}/><axis {axis}/><limit {limit}/>{more}</joint>"
    )


def urdf(links: Iterable[str], *joints: str, attributes: str = 'name="arm"') -> str:
    """A robot with these links and joints."""
    named = "".join(f'<link name="{link}"/>' for link in links)
    return f"<robot {attributes}>{named}{''.join(joints)}</robot>"


#: a - j1 - b - j2 - c.
J1, J2 = joint("j1", "a", "b"), joint("j2", "b", "c")
TWO_JOINTS = urdf("abc", J1, J2)


def planar_arm() -> str:
    """Three joints about z; the links between them are 1 m, the third has the end effector."""
    return urdf(
        ("base", "upper", "fore", "hand"),
        joint("shoulder", "base", "upper", origin="", limit='lower="-3" upper="3"'),
        joint("elbow", "upper", "fore", origin='xyz="1 0 0"', limit='lower="-3" upper="3"'),
        joint("wrist", "fore", "hand", origin='xyz="1 0 0"', limit='lower="-3" upper="3"'),
    )
