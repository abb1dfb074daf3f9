"""The arm of ``six_joint_arm`` whose first and last joint turn without limits."""

from __future__ import annotations

from support.six_joint_arm import BASE, BOX, FLANGE, URDF

#: Indices of these joints.
TURNING = [0, 5]

CONTINUOUS_URDF = URDF.replace(
    'name="swivel" type="revolute"', 'name="swivel" type="continuous"'
).replace('name="turn" type="revolute"', 'name="turn" type="continuous"')

#: How to load it: the first joint may turn all the way around, the last one a part of a turn.
OPTIONS = {
    "base_frame": BASE,
    "end_effector_frame": FLANGE,
    "joint_box": {joint: bounds for joint, bounds in BOX.items() if joint != "swivel"},
}
