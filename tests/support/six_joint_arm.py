"""The URDF of an arm that is not a packaged one, as an arm's maker would deliver it.

Six joints with a spherical wrist, between a stand and a gripper of two fingers, one of which
mimics the other: so the frames have to be said. The working box is one branch.
"""

from __future__ import annotations

BASE, FLANGE = "base", "flange"
JOINTS = ("swivel", "shoulder", "elbow", "roll", "bend", "turn")
#: As ``--joint-box`` takes them.
BOX = {
    "swivel": (-1.0, 1.0),
    "shoulder": (-1.2, -0.4),
    "elbow": (0.6, 1.6),
    "roll": (-1.0, 1.0),
    "bend": (0.5, 1.5),
    "turn": (-1.0, 1.0),
}


def _joint(name: str, kind: str, links: str, xyz: str, axis: str, more: str = "") -> str:
    parent, child = links.split()
    return f"""
  <joint name="{name}" type="{kind}">
    <parent link="{parent}"/>
    <child link="{child}"/>
    <origin xyz="{xyz}" rpy="0 0 0"/>
    <axis xyz="{axis}"/>{more}
  </joint>"""


_LIMIT = '<limit lower="-2.9" upper="2.9" effort="10" velocity="2"/>'
_STROKE = '<limit lower="0" upper="0.04" effort="10" velocity="2"/>'
_LINKS = (
    *("world", BASE, "column", "upper_arm", "forearm", "hand", "knuckle", FLANGE),
    *("palm", "left_finger", "right_finger"),
)

URDF = "".join(
    [
        '<?xml version="1.0"?>\n<robot name="bench_arm">',
        *(f'\n  <link name="{link}"/>' for link in _LINKS),
        _joint("stand", "fixed", f"world {BASE}", "0 0 0.7", "1 0 0"),
        _joint("swivel", "revolute", f"{BASE} column", "0 0 0.3", "0 0 1", _LIMIT),
        _joint("shoulder", "revolute", "column upper_arm", "0 0 0.1", "0 1 0", _LIMIT),
        _joint("elbow", "revolute", "upper_arm forearm", "0.4 0 0", "0 1 0", _LIMIT),
        _joint("roll", "revolute", "forearm hand", "0.35 0 0", "1 0 0", _LIMIT),
        _joint("bend", "revolute", "hand knuckle", "0 0 0", "0 1 0", _LIMIT),
        _joint("turn", "revolute", f"knuckle {FLANGE}", "0.08 0 0", "1 0 0", _LIMIT),
        _joint("mount", "fixed", f"{FLANGE} palm", "0.02 0 0", "1 0 0"),
        _joint("grip", "prismatic", "palm left_finger", "0.1 0 0", "0 1 0", _STROKE),
        _joint(
            "follow",
            "prismatic",
            "palm right_finger",
            "0.1 0 0",
            "0 -1 0",
            _STROKE + '<mimic joint="grip"/>',
        ),
        "\n</robot>\n",
    ]
)

#: What to give to the command line, after the URDF.
FRAMES = ("--base-frame", BASE, "--end-effector-frame", FLANGE)
JOINT_BOX = tuple(
    argument
    for joint, (lower, upper) in BOX.items()
    for argument in ("--joint-box", f"{joint}={lower}:{upper}")
)
