"""The Robotics Toolbox for Python's ik_LM, the solver in C++, with one start and with restarts.

Chan's damping with a gain of 1 and up to 30 iterations a search, its defaults. Its tolerance is on
half the square of the norm of the error, in metres and radians together: 5e-7 in that norm.
Its default of 1e-6 would be 1.4 mm. The first search starts at the centre of the joint box.

With restarts, up to 100 searches (the default), the joint box is given as the joint limits:
they reject a solution outside, and the next search starts at a random place within. With one start
there is nothing to gain from a rejection, so limits are off and the solution is returned as it is.

The chain is a sequence of elementary transforms with as few constants as there can be.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Kind, Peer, imported, installed_version
from benchmarks.ik.peers.pose_matrix import pose_matrix
from benchmarks.ik.peers.problem import IkProblem, free_chain

ONE_START = "roboticstoolbox LM, one start"
WITH_RESTARTS = "roboticstoolbox LM, restarts"
TOLERANCE = 5e-7
ITERATIONS = 30
SEARCHES = 100


class _RoboticsToolbox(Peer):
    kind: Kind = "numerical"

    def __init__(self, toolbox: ModuleType, problem: IkProblem, name: str, restarts: bool) -> None:
        self.name = name
        self.version = installed_version("roboticstoolbox-python")
        self._searches = SEARCHES if restarts else 1
        self._limited = restarts
        searches = f"up to {SEARCHES} random searches" if restarts else "one search"
        self.settings = (
            f"Chan, tolerance {TOLERANCE:g}, {searches} of {ITERATIONS} iterations, "
            f"start at box centre, {'limits = box' if restarts else 'no limits'}"
        )
        self._problem = problem
        self._transforms = _transforms(toolbox, problem)

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        found = self._transforms.ik_LM(
            pose_matrix(pose),
            q0=self._problem.free_of(start),
            ilimit=ITERATIONS,
            slimit=self._searches,
            tol=0.5 * TOLERANCE**2,
            joint_limits=self._limited,
        )
        if not found.success:
            return None
        return self._problem.with_locked(np.asarray(found.q, dtype=np.float64))


def make(problem: IkProblem) -> Peer:
    """The solver with one start.

    Raises:
        PeerUnavailable: if the toolbox is not installed.
    """
    return _RoboticsToolbox(_toolbox(ONE_START), problem, ONE_START, restarts=False)


def make_with_restarts(problem: IkProblem) -> Peer:
    """The solver with random restarts.

    Raises:
        PeerUnavailable: if the toolbox is not installed.
    """
    return _RoboticsToolbox(_toolbox(WITH_RESTARTS), problem, WITH_RESTARTS, restarts=True)


def _toolbox(name: str) -> ModuleType:
    return imported(name, "roboticstoolbox", "pip install roboticstoolbox-python")


def _transforms(toolbox: ModuleType, problem: IkProblem) -> Any:
    """The chain as an ETS of constants and joints that turn about z or slide along it."""
    chain = free_chain(problem)
    transforms = []
    undo = np.eye(4)
    for column, joint in enumerate(chain.joints):
        turn = joint.z_to_axis
        transforms.append(toolbox.ET.SE3(undo @ joint.placement @ turn))
        limits = np.array([bounds[column] for bounds in problem.free_box])
        along_z = toolbox.ET.tz if joint.prismatic else toolbox.ET.Rz
        transforms.append(along_z(jindex=column, qlim=limits))
        undo = turn.T
    tip = undo @ chain.tip
    if (tip != np.eye(4)).any():
        transforms.append(toolbox.ET.SE3(tip))
    return toolbox.ETS(transforms)
