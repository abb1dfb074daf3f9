"""Designs that fill the joint box without structure, drawn by SciPy's quasi-Monte Carlo module."""

import math

import numpy as np
from scipy.stats import qmc

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits


def random_design(box: JointLimits, examples: int, rng: np.random.Generator) -> FloatArray:
    """Independent uniform joint positions ``(examples, dof)``."""
    return box.sample(examples, rng)


def latin_hypercube_design(
    box: JointLimits, examples: int, rng: np.random.Generator
) -> FloatArray:
    """Joint positions ``(examples, dof)``, one in each of ``examples`` slices of every joint."""
    return _scaled(qmc.LatinHypercube(len(box.joint_names), seed=rng).random(examples), box)


def sobol_design(box: JointLimits, examples: int, rng: np.random.Generator) -> FloatArray:
    """The first ``examples`` points of a scrambled Sobol sequence ``(examples, dof)``.

    A longer design with the same seed begins with a shorter one, so that examples can be added.
    """
    sequence = qmc.Sobol(len(box.joint_names), seed=rng)
    # Drawn up to a power of two, for which the sequence is balanced, then cut.
    return _scaled(sequence.random_base2(math.ceil(math.log2(examples)))[:examples], box)


def _scaled(unit: FloatArray, box: JointLimits) -> FloatArray:
    scaled: FloatArray = box.lower + unit * (box.upper - box.lower)
    return scaled
