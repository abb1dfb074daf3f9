"""annik as two of the solvers: the network alone, and its output refined.

Both are :class:`annik_core.solver.ik_solver.IkSolver` as the node calls it, one target at a time
and without the previous solution, with its checks of target, workspace and joint limits. The
network alone has no limit on the residual: it does not reach the tolerance. Refined has the
default options.
"""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

from annik_core.installation import annik_version
from annik_core.model.artifact import Model
from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_core.safety import AcceptanceLimits
from annik_core.solver.ik_solver import IkSolver
from annik_core.solver.mode import SolverMode
from annik_core.solver.result import RefinementOptions
from annik_core.solver.search import SearchOptions
from annik_view.solvers import solver_for
from benchmarks.ik.peers.peer import Kind, Peer

NETWORK = "annik, network"
REFINED = "annik, refined"
NO_KERNEL = "annik, kernel off"
WHOLE_ROBOT = "annik"
AS_DESCRIBED = "annik, robot as described"


@runtime_checkable
class BatchSolver(Protocol):
    """A solver that takes many poses in one call."""

    def solve_batch(self, poses: FloatArray) -> object:
        """Solve poses ``(n, 7)``; only the time is of interest."""
        ...


class _Annik(Peer):
    kind: Kind = "ours"

    def __init__(self, name: str, solver: IkSolver, settings: str) -> None:
        self.name = name
        self.version = annik_version()
        self.settings = settings
        self._solver = solver

    def solve(self, pose: FloatArray, start: FloatArray | None = None) -> FloatArray | None:
        """See :meth:`benchmarks.ik.peers.peer.Peer.solve`."""
        return self._solver.solve(pose, start).joint_positions

    def solutions(self, pose: FloatArray) -> list[FloatArray]:
        """See :meth:`benchmarks.ik.peers.peer.SolvesAll.solutions`."""
        found = (result.joint_positions for result in self._solver.solutions(pose))
        return [positions for positions in found if positions is not None]

    def solve_batch(self, poses: FloatArray) -> object:
        """See :class:`BatchSolver`; on one thread, as the others are called."""
        return self._solver.solve_batch(poses, threads=1)


def refined(artifact: Model, name: str = REFINED) -> Peer:
    """annik, refined, under a name."""
    solver = IkSolver(artifact, mode=SolverMode.REFINED)
    options = solver.refinement_options
    return _Annik(
        name,
        solver,
        f"tolerance {options.tolerance:g}, up to {options.max_newton_steps} steps from the "
        "network's output, no random restarts, limits = box",
    )


def whole_robot(robot: Robot) -> Peer:
    """The solver on the whole of an arm, without a network."""
    options = SearchOptions()
    return _Annik(
        WHOLE_ROBOT,
        solver_for(robot),
        f"no network, tolerance {RefinementOptions().tolerance:g}, up to {options.max_starts} "
        "starts from computed examples and a low-discrepancy sequence",
    )


def our_solvers(artifact: Model) -> list[Peer]:
    """Network and refined, both with the network of one model file."""
    open_limits = AcceptanceLimits(math.inf, math.inf)
    return [
        _Annik(
            NETWORK,
            IkSolver(artifact, open_limits, SolverMode.NETWORK),
            "the network's output as it is, no limit on the residual",
        ),
        refined(artifact),
    ]
