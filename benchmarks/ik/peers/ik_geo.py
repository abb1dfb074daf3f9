"""IK-Geo: closed forms by subproblem decomposition, for arms that have one, through ik-geo.

IK-Geo needs the arm's family. It is found here from the axes: a spherical wrist or three
parallel axes, plain or with two parallel or two intersecting axes besides. Other arms it solves by
a search over one or two joints, which is no closed form and is not used. The family is
checked on a few poses.

A closed form has no start, no tolerance and no restarts: it gives all solutions. Of those the one
in the joint box that is nearest to its centre is taken, else the nearest of all. What IK-Geo
marks as a least-squares solution, close to a pose that can't be reached, counts only if all are
so marked and IK-Geo's own forward kinematics leads to the pose: on some arms exact ones are marked
too. Locked joints are fixed in its chain. It does arms of six revolute joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.closed_form import chosen_solution, exact_solutions
from benchmarks.ik.peers.peer import Kind, Peer, PeerUnavailable, imported, installed_version
from benchmarks.ik.peers.pose_matrix import pose_matrix
from benchmarks.ik.peers.problem import IkProblem, free_chain
from benchmarks.ik.peers.serial_chain import SerialChain

NAME = "IK-Geo"

#: Axes are parallel or meet if they do so within this, as a sine or in metres.
EXACT = 1e-9
#: How near a solution has to lead to its pose for the family to be the right one [m, entries].
RIGHT = 1e-6


class _IkGeo(Peer):
    name = NAME
    kind: Kind = "closed form"

    def __init__(self, ik_geo: ModuleType, problem: IkProblem) -> None:
        self._problem = problem
        self.version = installed_version("ik-geo")
        chain = free_chain(problem)
        if len(chain.joints) != 6 or any(joint.prismatic for joint in chain.joints):
            raise PeerUnavailable(NAME, "can't do this robot: it does six revolute joints only")
        # IK-Geo's end effector is turned as the base when all joints are at zero.
        self._tip = chain.zero_placements[-1][:3, :3]
        for family, robot in _robots(ik_geo, chain):
            self._robot = robot
            self.settings = (
                f"family {family}, of all solutions the one in the box nearest to its centre"
            )
            if self._right(chain):
                return
        raise PeerUnavailable(NAME, "can't do this robot: it knows no closed form for it")

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        exact = self.solutions(pose)
        return chosen_solution(exact, self._problem, start) if exact else None

    def solutions(self, pose: FloatArray) -> list[list[float]]:
        """See :meth:`benchmarks.ik.peers.peer.SolvesAll.solutions`."""
        return self._solutions(pose_matrix(pose))

    def _solutions(self, target: FloatArray) -> list[list[float]]:
        """The exact solutions, each ``(6,)`` [rad], for a placement ``(4, 4)``."""
        # ik-geo takes the columns of a rotation where numpy has its rows: so it is transposed.
        found = self._robot.get_ik(self._tip @ target[:3, :3].T, target[:3, 3])
        return exact_solutions(found, self._forward, target)

    def _forward(self, positions: list[float]) -> FloatArray:
        """IK-Geo's own forward kinematics ``(4, 4)``, of joint positions ``(6,)`` [rad]."""
        columns, place = self._robot.forward_kinematics(positions)
        placement = np.eye(4)
        placement[:3, :3] = np.array(columns).T @ self._tip
        placement[:3, 3] = place
        return placement

    def _right(self, chain: SerialChain) -> bool:
        """Whether solutions lead to the poses that they are for."""
        random = np.random.default_rng(0)
        lower, upper = self._problem.free_box
        for _ in range(3):
            target = chain.tip_placement(random.uniform(lower, upper))
            solutions = self._solutions(target)
            if not any(
                np.abs(chain.tip_placement(np.array(solution)) - target).max() < RIGHT
                for solution in solutions
            ):
                return False
        return True


def make(problem: IkProblem) -> Peer:
    """IK-Geo for a problem.

    Raises:
        PeerUnavailable: if ik-geo is not installed, or knows no closed form for the robot.
    """
    return _IkGeo(imported(NAME, "ik_geo", "pip install ik-geo"), problem)


def _robots(ik_geo: ModuleType, chain: SerialChain) -> Iterator[tuple[str, Any]]:
    """The families that the axes belong to, the more special first, each with its solver."""
    frames = chain.zero_placements
    axes = np.stack(
        [frame[:3, :3] @ joint.axis for frame, joint in zip(frames, chain.joints, strict=False)]
    )
    points = frames[:-1, :3, 3].copy()

    def parallel(first: int, second: int) -> bool:
        return float(np.linalg.norm(np.cross(axes[first], axes[second]))) < EXACT

    first_two = _meeting(points[0], axes[0], points[1], axes[1])
    wrist = _meeting(points[4], axes[4], points[5], axes[5])
    if wrist is None:
        return
    spherical = _distance(wrist, points[3], axes[3]) < EXACT
    # The families take points of axes that meet to be the same.
    points[4] = points[5] = wrist
    if spherical:
        points[3] = wrist
    if first_two is not None:
        points[0] = points[1] = first_two
    origins = np.vstack([np.zeros(3), points, frames[-1, :3, 3]])
    offsets = np.diff(origins, axis=0)
    if spherical:
        if parallel(1, 2):
            yield "spherical_two_parallel", ik_geo.Robot.spherical_two_parallel(axes, offsets)
        if first_two is not None:
            yield (
                "spherical_two_intersecting",
                ik_geo.Robot.spherical_two_intersecting(axes, offsets),
            )
        yield "spherical", ik_geo.Robot.spherical(axes, offsets)
    if parallel(1, 2) and parallel(2, 3):
        yield (
            "three_parallel_two_intersecting",
            ik_geo.Robot.three_parallel_two_intersecting(axes, offsets),
        )
        yield "three_parallel", ik_geo.Robot.three_parallel(axes, offsets)


def _meeting(
    point: FloatArray, axis: FloatArray, other_point: FloatArray, other_axis: FloatArray
) -> FloatArray | None:
    """Where two axes meet ``(3,)``, or None if they are parallel or pass each other."""
    normal = np.cross(axis, other_axis)
    square = float(normal @ normal)
    between = other_point - point
    if square < EXACT**2 or abs(float(between @ normal)) > EXACT * square**0.5:
        return None
    meeting: FloatArray = point + axis * (np.cross(between, other_axis) @ normal / square)
    return meeting


def _distance(place: FloatArray, point: FloatArray, axis: FloatArray) -> float:
    """From a place to an axis [m]."""
    return float(np.linalg.norm(np.cross(place - point, axis)))
