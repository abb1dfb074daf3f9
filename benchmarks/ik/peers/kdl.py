"""KDL's Levenberg-Marquardt solver, ChainIkSolverPos_LMA, through PyKDL.

All six weights are 1, not KDL's default of 0.01 on rotations, so that its tolerance, the norm of
the error in metres and radians together, means the same for both: 1e-7. Up to 500
iterations, KDL's default; no restarts; from the centre of the joint box. It knows no limits, so
it is given none. A locked joint is a fixed one in its chain.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Kind, Peer, PeerUnavailable, imported
from benchmarks.ik.peers.problem import IkProblem, free_chain
from benchmarks.ik.peers.serial_chain import SerialChain

NAME = "KDL LMA"
TOLERANCE = 1e-7
ITERATIONS = 500

#: What pybind11 gives each class since a little after it learned of numpy 2.
NEW_PYBIND11 = "_pybind11_conduit_v1_"


class _Kdl(Peer):
    name = NAME
    kind: Kind = "numerical"
    settings = (
        f"weights 1, tolerance {TOLERANCE:g}, up to {ITERATIONS} iterations, no restart, "
        "start at box centre, no limits"
    )

    def __init__(self, pykdl: ModuleType, problem: IkProblem) -> None:
        self._kdl = pykdl
        self._problem = problem
        self.version = str(getattr(pykdl, "__version__", "unknown"))
        # The solver only refers to its chain, so this keeps it.
        self._chain = kdl_chain(pykdl, free_chain(problem))
        self._solver = pykdl.ChainIkSolverPos_LMA(self._chain, np.ones(6), TOLERANCE, ITERATIONS)
        self._free = len(problem.free)
        self._start = pykdl.JntArray(self._free)
        self._found = pykdl.JntArray(self._free)

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        kdl = self._kdl
        x, y, z, qx, qy, qz, qw = pose.tolist()
        target = kdl.Frame(kdl.Rotation.Quaternion(qx, qy, qz, qw), kdl.Vector(x, y, z))
        for column, position in enumerate(self._problem.free_of(start).tolist()):
            self._start[column] = position
        if self._solver.CartToJnt(self._start, target, self._found) != 0:
            return None
        found = self._found
        return self._problem.with_locked(np.array([found[column] for column in range(self._free)]))


def make(problem: IkProblem) -> Peer:
    """KDL's solver for a problem.

    Raises:
        PeerUnavailable: if PyKDL is not installed, or crashes with this numpy.
    """
    pykdl = imported(NAME, "PyKDL", "apt-get install python3-pykdl")
    # A pybind11 that old reads arrays of numpy 2 wrongly, and takes the whole process with it.
    if int(np.__version__.partition(".")[0]) >= 2 and not hasattr(pykdl.Chain, NEW_PYBIND11):
        raise PeerUnavailable(
            NAME, f"PyKDL {pykdl.__version__} is built for numpy 1 and would crash: use numpy<2"
        )
    return _Kdl(pykdl, problem)


def kdl_chain(pykdl: ModuleType, chain: SerialChain) -> Any:
    """A PyKDL.Chain, its segments as kdl_parser makes them of a URDF."""
    kdl = pykdl
    made = kdl.Chain()
    for joint in chain.joints:
        placement = _frame(kdl, joint.placement)
        axis = placement.M * kdl.Vector(*joint.axis.tolist())
        kind = kdl.Joint.TransAxis if joint.prismatic else kdl.Joint.RotAxis
        made.addSegment(
            kdl.Segment(joint.name, kdl.Joint(joint.name, placement.p, axis, kind), placement)
        )
    made.addSegment(kdl.Segment("tip", kdl.Joint("tip", kdl.Joint.Fixed), _frame(kdl, chain.tip)))
    return made


def _frame(pykdl: ModuleType, placement: FloatArray) -> Any:
    rotation = pykdl.Rotation(*placement[:3, :3].ravel().tolist())
    return pykdl.Frame(rotation, pykdl.Vector(*placement[:3, 3].tolist()))
