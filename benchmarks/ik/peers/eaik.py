"""EAIK: closed forms by subproblem decomposition, for arms that have one.

A closed form has no start, no tolerance and no restarts: it gives all solutions. Of those the one
in the joint box that is nearest to its centre is taken, else the nearest of all. What EAIK marks
as a least-squares solution, close to a pose that can't be reached, counts only if all are so
marked and EAIK's own forward kinematics leads to the pose: on some arms it marks exact ones too.
Locked joints are fixed in its chain. It does arms of up to six joints, all revolute.
"""

from __future__ import annotations

from types import ModuleType

from annik_core.pose import FloatArray
from benchmarks.ik.peers.closed_form import chosen_solution, exact_solutions
from benchmarks.ik.peers.peer import Kind, Peer, PeerUnavailable, imported, installed_version
from benchmarks.ik.peers.pose_matrix import pose_matrix
from benchmarks.ik.peers.problem import IkProblem, free_chain

NAME = "EAIK"


class _Eaik(Peer):
    name = NAME
    kind: Kind = "closed form"

    def __init__(self, homogeneous: ModuleType, problem: IkProblem) -> None:
        self._problem = problem
        self.version = installed_version("EAIK")
        chain = free_chain(problem)
        if len(chain.joints) > 6 or any(joint.prismatic for joint in chain.joints):
            raise PeerUnavailable(
                NAME, "can't do this robot: it does up to six revolute joints only"
            )
        frames = chain.zero_placements
        for frame, joint in zip(frames, chain.joints, strict=False):
            frame[:] = frame @ joint.z_to_axis
        self._robot = homogeneous.HomogeneousRobot(frames)
        if not self._robot.hasKnownDecomposition():
            raise PeerUnavailable(NAME, "can't do this robot: it knows no closed form for it")
        self.settings = (
            f"family {self._robot.getKinematicFamily()}, of all solutions the one in the box "
            "nearest to its centre"
        )

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        exact = self.solutions(pose)
        return chosen_solution(exact, self._problem, start) if exact else None

    def solutions(self, pose: FloatArray) -> list[list[float]]:
        """See :meth:`benchmarks.ik.peers.peer.SolvesAll.solutions`."""
        target = pose_matrix(pose)
        found = self._robot.IK(target)
        solutions = list(zip(found.Q.tolist(), found.is_LS.tolist(), strict=True))
        return exact_solutions(solutions, self._robot.fwdKin, target)


def make(problem: IkProblem) -> Peer:
    """EAIK for a problem.

    Raises:
        PeerUnavailable: if EAIK is not installed, or knows no closed form for the robot.
    """
    return _Eaik(imported(NAME, "eaik.IK_Homogeneous", "pip install EAIK"), problem)
