"""Answer targets as a node does: one at a time, in a process that has never loaded torch.

``python -m benchmarks.answer_targets MODEL TARGETS ANSWERS``: reads poses ``(n, 7)`` from the npy
file TARGETS; writes the npz file ANSWERS with ``joint_positions`` ``(n, dof)``, NaN where refused,
``newton_steps`` ``(n,)`` and ``microseconds`` ``(n,)``. All targets are answered several times
over; the times are those of the quietest pass, the one with the least median: a machine that is
shared is slow for seconds at a time.
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

#: Targets answered before the clock runs: caches and the processor's clock settle.
_WARM_UP = 500
#: How often all targets are answered.
PASSES = 10


class Answers(NamedTuple):
    """What a solver said to ``n`` targets.

    Attributes:
        joint_positions: ``(n, dof)`` [rad or m], NaN where refused.
        newton_steps: ``(n,)``.
        microseconds: ``(n,)`` for each answer, in the quietest pass [us].
    """

    joint_positions: FloatArray
    newton_steps: NDArray[np.int64]
    microseconds: FloatArray


def answers_of(model: Path, targets: FloatArray) -> Answers:
    """The answers of a model to poses ``(n, 7)``, given in a process of their own."""
    with tempfile.TemporaryDirectory() as folder:
        questions, answers = Path(folder) / "targets.npy", Path(folder) / "answers.npz"
        np.save(questions, targets)
        subprocess.run(
            [sys.executable, "-m", "benchmarks.answer_targets", model, questions, answers],
            check=True,
        )
        with np.load(answers) as arrays:
            return Answers(*(arrays[name] for name in Answers._fields))


def _answer(model: Path, targets: FloatArray) -> Answers:
    solver = IkSolver.from_file(model)
    for pose in targets[:_WARM_UP]:
        solver.solve(pose)
    passes = [_one_pass(solver, targets) for _ in range(PASSES)]
    return min(passes, key=lambda answers: float(np.median(answers.microseconds)))


def _one_pass(solver: IkSolver, targets: FloatArray) -> Answers:
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
    return Answers(joint_positions, newton_steps, microseconds)


if __name__ == "__main__":
    given = _answer(Path(sys.argv[1]), np.load(sys.argv[2]))
    np.savez(sys.argv[3], **given._asdict())
