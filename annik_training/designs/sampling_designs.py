"""Designs that fill the joint box without structure, drawn by SciPy's quasi-Monte Carlo module."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import qmc

from annik_core.pose import FloatArray
from annik_core.robots.joint_limits import JointLimits
from annik_training.designs.errors import InvalidDesignSize

MAX_EXAMPLES = 1_000_000


def random_design(box: JointLimits, examples: int, rng: np.random.Generator) -> FloatArray:
    """Independent uniform joint positions ``(examples, dof)``.

    Raises:
        InvalidDesignSize: if ``examples`` is out of range; likewise for the others.
    """
    _check("random", examples)
    return box.sample(examples, rng)


def latin_hypercube_design(
    box: JointLimits, examples: int, rng: np.random.Generator
) -> FloatArray:
    """Joint positions ``(examples, dof)``, one in each of as many slices of every joint."""
    _check("latin_hypercube", examples)
    return _scaled(qmc.LatinHypercube(len(box.joint_names), seed=rng).random(examples), box)


def sobol_design(box: JointLimits, examples: int, rng: np.random.Generator) -> FloatArray:
    """The first ``examples`` points of a scrambled Sobol sequence ``(examples, dof)``.

    A longer design with the same seed begins with a shorter one, so that examples can be added.
    """
    _check("sobol", examples)
    sequence = qmc.Sobol(len(box.joint_names), seed=rng)
    # Drawn up to a power of two, which is what the sequence is balanced for, then cut.
    return _scaled(sequence.random_base2(math.ceil(math.log2(examples)))[:examples], box)


def _check(design: str, examples: int) -> None:
    if not 1 <= examples <= MAX_EXAMPLES:
        raise InvalidDesignSize(design, "examples", examples, 1, MAX_EXAMPLES)


def _scaled(unit: FloatArray, box: JointLimits) -> FloatArray:
    scaled: FloatArray = box.lower + unit * (box.upper - box.lower)
    return scaled
