"""TRAC-IK, through pytracik.

Speed mode: the first solution, of KDL's Newton solver with restarts and of SQP, which run side by
side in two threads. 5 ms at most, TRAC-IK's default. Its tolerance holds for each of the six
components, so 5e-7 leaves the norms of the three below 1e-6. It starts at the centre of the
joint box, and is given the joint box as its limits, which the solvers respect: so it stays on
the branch of the targets. Its restarts are random and not seeded, so that counts differ from run
to run. It is called below pytracik's class TracIK, which would first turn a matrix into a
quaternion, by eigenvalues, for the sake of a target that is a quaternion here.
"""

from __future__ import annotations

from types import ModuleType

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Kind, Peer, imported, installed_version
from benchmarks.ik.peers.problem import IkProblem, locked_urdf

NAME = "TRAC-IK"
TOLERANCE = 5e-7
TIME_LIMIT = 0.005


class _TracIk(Peer):
    name = NAME
    kind: Kind = "numerical"
    settings = (
        f"Speed, tolerance {TOLERANCE:g} per component, random restarts within "
        f"{1e3 * TIME_LIMIT:g} ms, start at box centre, limits = box"
    )

    def __init__(self, pytracik: ModuleType, problem: IkProblem) -> None:
        self._pytracik = pytracik
        self._problem = problem
        self.version = installed_version("pytracik")
        self._solver = pytracik.TRAC_IK(
            problem.base_frame,
            problem.end_effector_frame,
            locked_urdf(problem),
            TIME_LIMIT,
            TOLERANCE,
            pytracik.SolveType.Speed,
        )

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        found: FloatArray = self._pytracik.ik(
            self._solver, self._problem.free_of(start), *pose.tolist()
        )
        if found[0] < 0.0:
            return None
        return self._problem.with_locked(found[1:])


def make(problem: IkProblem) -> Peer:
    """TRAC-IK for a problem.

    Raises:
        PeerUnavailable: if pytracik is not installed.
    """
    return _TracIk(imported(NAME, "pytracik", "pip install pytracik"), problem)
