"""Solve targets as a node does: one at a time, in a process that has never loaded torch.

``python -m benchmarks.solve_targets MODEL TARGETS SOLUTIONS``: reads poses ``(n, 7)`` from the npy
file TARGETS; writes the npz file SOLUTIONS with ``joint_positions`` ``(n, dof)``, NaN where
refused, ``newton_steps`` ``(n,)`` and ``microseconds`` ``(n,)``. All targets are solved in several
passes; the times are those of the pass with the least median, as a shared machine is slow for
seconds at a time.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from annik_core.pose import FloatArray
from annik_core.solver.ik_solver import IkSolver

#: Targets before the first timed one: caches and the processor's clock settle.
_WARM_UP = 500
#: Number of passes.
PASSES = 10


class Solutions(NamedTuple):
    """The solutions of ``n`` targets.

    Attributes:
        joint_positions: ``(n, dof)`` [rad or m], NaN where refused.
        newton_steps: ``(n,)``.
        microseconds: ``(n,)`` of each solve, in the quietest pass [us].
    """

    joint_positions: FloatArray
    newton_steps: NDArray[np.int64]
    microseconds: FloatArray


def solutions_of(model: Path, targets: FloatArray) -> Solutions:
    """The solutions of a model for poses ``(n, 7)``, from a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        poses, solutions = Path(folder) / "targets.npy", Path(folder) / "solutions.npz"
        np.save(poses, targets)
        subprocess.run(
            [sys.executable, "-m", "benchmarks.solve_targets", model, poses, solutions],
            check=True,
        )
        with np.load(solutions) as arrays:
            return Solutions(*(arrays[name] for name in Solutions._fields))


def _solve_all(model: Path, targets: FloatArray) -> Solutions:
    solver = IkSolver.from_file(model)
    for pose in targets[:_WARM_UP]:
        solver.solve(pose)
    passes = [_one_pass(solver, targets) for _ in range(PASSES)]
    return min(passes, key=lambda found: float(np.median(found.microseconds)))


def _one_pass(solver: IkSolver, targets: FloatArray) -> Solutions:
    joint_positions = np.full((len(targets), solver.robot.dof), np.nan)
    newton_steps = np.zeros(len(targets), dtype=np.int64)
    microseconds = np.empty(len(targets))
    for row, pose in enumerate(targets):
        begin = time.perf_counter_ns()
        result = solver.solve(pose)
        microseconds[row] = 1e-3 * (time.perf_counter_ns() - begin)
        newton_steps[row] = result.newton_steps
        if result.joint_positions is not None:
            joint_positions[row] = result.joint_positions
    return Solutions(joint_positions, newton_steps, microseconds)


if __name__ == "__main__":
    found = _solve_all(Path(sys.argv[1]), np.load(sys.argv[2]))
    np.savez(sys.argv[3], **found._asdict())
