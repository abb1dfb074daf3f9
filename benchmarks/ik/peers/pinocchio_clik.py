"""Closed-loop inverse kinematics with Pinocchio: the loop of its documentation's example.

Damped Gauss-Newton on log6 of the error, with Jlog6 and a damping of 1e-12 as there. The
example moves by a tenth of each step, to show the loop; here the whole step is taken, without
which 1e-7 would be some 150 iterations away. Up to 100 iterations, from the centre of the joint
box, no restarts, nothing clipped: it knows no limits. The loop is in Python as in the example.
Locked joints are fixed in its model.
"""

from __future__ import annotations

from types import ModuleType

import numpy as np

from annik_core.pose import FloatArray
from benchmarks.ik.peers.peer import Kind, Peer, imported
from benchmarks.ik.peers.problem import IkProblem, locked_urdf

NAME = "Pinocchio CLIK"
TOLERANCE = 1e-7
ITERATIONS = 100
DAMPING = 1e-12


class _PinocchioClik(Peer):
    name = NAME
    kind: Kind = "numerical"
    settings = (
        f"step 1, damping {DAMPING:g}, tolerance {TOLERANCE:g}, up to {ITERATIONS} iterations, "
        "no restart, start at box centre, no limits"
    )

    def __init__(self, pinocchio: ModuleType, problem: IkProblem) -> None:
        self._pin = pinocchio
        self._problem = problem
        self.version = str(pinocchio.__version__)
        self._model = pinocchio.buildModelFromXML(locked_urdf(problem))
        self._data = self._model.createData()
        self._frame = self._model.getFrameId(problem.end_effector_frame)
        self._damping = DAMPING * np.eye(6)

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        pin, model, data, frame = self._pin, self._model, self._data, self._frame
        target = pin.XYZQUATToSE3(pose)
        positions = self._problem.free_of(start).copy()
        for _ in range(ITERATIONS):
            pin.forwardKinematics(model, data, positions)
            missing = pin.updateFramePlacement(model, data, frame).actInv(target)
            error = pin.log6(missing).vector
            if np.linalg.norm(error) < TOLERANCE:
                return self._problem.with_locked(positions)
            jacobian = pin.computeFrameJacobian(model, data, positions, frame, pin.LOCAL)
            jacobian = -np.dot(pin.Jlog6(missing.inverse()), jacobian)
            damped = jacobian.dot(jacobian.T) + self._damping
            try:
                step = -jacobian.T.dot(np.linalg.solve(damped, error))
            except np.linalg.LinAlgError:
                return None
            positions = positions + step
        return None


def make(problem: IkProblem) -> Peer:
    """Pinocchio's loop for a problem.

    Raises:
        PeerUnavailable: if Pinocchio is not installed.
    """
    return _PinocchioClik(imported(NAME, "pinocchio", "pip install pin"), problem)
