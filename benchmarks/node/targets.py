"""Targets that a robot reaches, as the bytes of messages."""

from __future__ import annotations

import struct

import numpy as np

from annik_core.model.artifact import load_model
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_core.solver.ik_solver import IkSolver

_POSE = struct.Struct("<4s7d")
#: Little endian CDR, no options.
_HEADER = b"\x00\x01\x00\x00"
#: Poses drawn in excess, as a model may not solve all.
_SPARE = 20


def pose_to_bytes(pose: FloatArray) -> bytes:
    """A ``geometry_msgs/msg/Pose`` ``(7,)`` as DDS carries it."""
    return _POSE.pack(_HEADER, *pose.tolist())


def solvable_targets(model: str, count: int, rng: np.random.Generator) -> list[bytes]:
    """Random poses of the joint box of a packaged model, all of which it solves.

    Args:
        model: its name.
        count: how many.
        rng: draws them.
    """
    solver = IkSolver(load_model(model))
    found: list[bytes] = []
    while len(found) < count:
        poses = random_poses(solver.robot, count - len(found) + _SPARE, rng)
        found += [pose_to_bytes(pose) for pose in poses if solver.solve(pose).accepted]
    return found[:count]


def random_poses(robot: Robot, count: int, rng: np.random.Generator) -> FloatArray:
    """Poses ``(count, 7)`` of random joint positions of the box, no two with the same x."""
    joints = robot.joint_box.sample(count + _SPARE, rng)
    poses = robot.forward_kinematics.poses(joints)
    # Targets are identified by their x; two of a million random numbers may be equal.
    first = np.unique(poses[:, 0], return_index=True)[1]
    return poses[np.sort(first)[:count]]
