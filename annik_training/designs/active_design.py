"""An adaptive design: the next examples are where networks fitted to the others disagree.

Query by committee [Seung1992]_: several networks are fitted to the examples so far, from different
random initial weights; where they agree, an example would teach little. A candidate's score is the
standard deviation of their outputs times its distance to the nearest example, so that a batch does
not gather in one place.

Only the forward kinematics of the candidates is evaluated, not their targets.

References:
    [Seung1992] H. S. Seung, M. Opper, H. Sompolinsky: Query by committee. COLT 1992.
"""

import numpy as np
from scipy.spatial.distance import cdist

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_training.designs.sampling_designs import random_design, sobol_design
from annik_training.errors import UnsupportedRobot
from annik_training.fitting.fit import Restart, examples_of, fit_restarts
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import InverseKinematicsSystem, System

_FIRST_EXAMPLES_PER_JOINT = 2
_GROWTH = 0.25
_COMMITTEE = 4
_EVALUATIONS = 20
_CANDIDATES = 1024
#: Added to the standard deviation: where all networks agree, the distance decides.
_LEAST_SPREAD = 1e-9


def active_design(subject: System | Robot, examples: int, rng: np.random.Generator) -> FloatArray:
    """Joint positions ``(examples, dof)``, in the order in which they were chosen.

    The first are a Sobol sequence, two for each joint; then each round adds a quarter.

    Raises:
        UnsupportedRobot: if the subject has no forward kinematics.
    """
    system = InverseKinematicsSystem(subject) if isinstance(subject, Robot) else subject
    if not hasattr(system, "inputs"):
        raise UnsupportedRobot("design active", system.name, "it has no forward kinematics")
    box = system.joint_box
    first = min(examples, _FIRST_EXAMPLES_PER_JOINT * len(box.joint_names))
    chosen = sobol_design(box, first, rng)
    while len(chosen) < examples:
        batch = min(examples - len(chosen), max(1, int(_GROWTH * len(chosen))))
        committee = _fitted_committee(system, chosen, int(rng.integers(2**31)))
        candidates = random_design(box, _CANDIDATES, rng)
        spread = _spread(committee, system.inputs(candidates))
        width = np.where(box.upper > box.lower, box.upper - box.lower, 1.0)
        picked = _spread_out(spread, candidates / width, chosen / width, batch)
        chosen = np.concatenate([chosen, candidates[picked]])
    return chosen


def _fitted_committee(
    system: System, joint_positions: FloatArray, seed: int
) -> tuple[Restart, ...]:
    options = FitOptions(
        restarts=_COMMITTEE, held_out_fraction=0.0, max_evaluations=_EVALUATIONS, seed=seed
    )
    return fit_restarts(examples_of(system, joint_positions, options), options)


def _spread(committee: tuple[Restart, ...], inputs: FloatArray) -> FloatArray:
    """Standard deviation ``(n,)`` of the scaled outputs of the networks, rms over the outputs."""
    outputs = np.stack([restart.network.predict(inputs) for restart in committee])
    scale = committee[0].network.output_scaling.half_width.numpy()
    spread: FloatArray = np.sqrt(np.mean((outputs.std(axis=0) / scale) ** 2, axis=1))
    return spread


def _spread_out(
    spread: FloatArray, candidates: FloatArray, chosen: FloatArray, batch: int
) -> list[int]:
    """Indices of the candidates of highest score; those picked before count as examples."""
    distance = cdist(candidates, chosen).min(axis=1)
    picked: list[int] = []
    for _ in range(batch):
        best = int(np.argmax((spread + _LEAST_SPREAD) * distance))
        picked.append(best)
        distance = np.minimum(distance, cdist(candidates, candidates[best : best + 1])[:, 0])
    return picked
