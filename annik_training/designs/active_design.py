"""An adaptive design: the next examples are where networks that fit the others disagree.

Query by committee [Seung1992]_: several networks are fitted to the examples so far from different
random starts; where they agree, an example would teach little. The spread of their answers, times
the distance to the nearest example (so that a batch does not gather in one place), is the score.

It needs the forward kinematics of the candidates, which a nominal model gives; their targets, the
joint positions to be predicted, are not looked at.

References:
    [Seung1992] H. S. Seung, M. Opper, H. Sompolinsky: Query by committee. COLT 1992.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from annik_core.pose import FloatArray
from annik_training.designs.errors import InvalidDesignSize
from annik_training.designs.sampling_designs import random_design, sobol_design
from annik_training.fitting.fit import FittedStarts, examples_of, fit_starts
from annik_training.fitting.options import FitOptions
from annik_training.fitting.problem import System

NAME = "active"
#: Each round fits a committee to all examples, so that thousands of them would take hours.
MAX_EXAMPLES = 2000

_FIRST_EXAMPLES_PER_JOINT = 2
_GROWTH = 0.25
_COMMITTEE = 4
_EVALUATIONS = 20
_CANDIDATES = 1024
#: Spread that counts even where all agree: then the distance alone decides.
_LEAST_SPREAD = 1e-9


def active_design(system: System, examples: int, rng: np.random.Generator) -> FloatArray:
    """Joint positions ``(examples, dof)``, in the order in which they were chosen.

    The first are a Sobol sequence, two for each joint; then a quarter more each round.

    Args:
        system: what is to be learned.
        examples: how many.
        rng: what the sequence, the candidates and the committees are drawn from.

    Raises:
        InvalidDesignSize: if ``examples`` is out of range.
    """
    if not 1 <= examples <= MAX_EXAMPLES:
        raise InvalidDesignSize(NAME, "examples", examples, 1, MAX_EXAMPLES)
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


def _fitted_committee(system: System, joint_positions: FloatArray, seed: int) -> FittedStarts:
    options = FitOptions(
        restarts=_COMMITTEE, held_out_fraction=0.0, max_evaluations=_EVALUATIONS, seed=seed
    )
    return fit_starts(examples_of(system, joint_positions, options), options)


def _spread(committee: FittedStarts, inputs: FloatArray) -> FloatArray:
    """Standard deviation of the answers ``(n,)``, scaled, rms over the outputs."""
    answers = np.stack([network.predict(inputs) for network in committee.networks])
    scale = committee.network.output_scaling.half_width.numpy()
    spread: FloatArray = np.sqrt(np.mean((answers.std(axis=0) / scale) ** 2, axis=1))
    return spread


def _spread_out(
    spread: FloatArray, candidates: FloatArray, chosen: FloatArray, batch: int
) -> list[int]:
    """Candidates of the highest score, the distance being to those picked before as well."""
    distance = cdist(candidates, chosen).min(axis=1)
    picked: list[int] = []
    for _ in range(batch):
        best = int(np.argmax((spread + _LEAST_SPREAD) * distance))
        picked.append(best)
        distance = np.minimum(distance, cdist(candidates, candidates[best : best + 1])[:, 0])
    return picked
